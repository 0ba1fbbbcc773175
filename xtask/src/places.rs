//! Where in the source an address of a firmware comes from. Link-time optimisation melts functions together, so it is the
//! debug information that tells: an address has a stack of inlined functions.

use std::fs;
use std::path::Path;
use std::process::Stdio;

use anyhow::{Context, Result};

use crate::packages::{self, NM};
use crate::shell;
use crate::toolchain::target_dir;

/// One function of such a stack.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Its path, demangled.
    pub function: String,
    /// File and line.
    pub place: String,
}

/// The stack of each address, the innermost function first.
pub fn of(elf: &Path, addresses: impl Iterator<Item = u64>) -> Result<Vec<(u64, Vec<Frame>)>> {
    packages::ready(&[NM])?;
    let list = target_dir().join("addresses.txt");
    let text: String = addresses.map(|address| format!("{address:#x}\n")).collect();
    fs::write(&list, text)?;
    let mut addr2line = shell::command("arm-none-eabi-addr2line");
    addr2line
        .args(["-a", "-i", "-f", "-C", "-e"])
        .arg(elf)
        .stdin(Stdio::from(fs::File::open(&list)?));
    stacks(&shell::run(&mut addr2line)?)
}

/// An address stands alone in its line, then come two lines for each frame.
fn stacks(answer: &str) -> Result<Vec<(u64, Vec<Frame>)>> {
    let mut stacks: Vec<(u64, Vec<Frame>)> = Vec::new();
    let mut lines = answer.lines();
    while let Some(line) = lines.next() {
        if let Some(address) = line.strip_prefix("0x") {
            stacks.push((u64::from_str_radix(address, 16)?, Vec::new()));
            continue;
        }
        let (_, frames) = stacks.last_mut().context("an address first")?;
        frames.push(Frame {
            function: line.to_owned(),
            place: lines.next().context("a place")?.to_owned(),
        });
    }
    Ok(stacks)
}

/// File of the library that a frame stands in, from `src/` on.
pub fn own(frame: &Frame) -> Option<&str> {
    let place = frame.place.as_str();
    let root = shell::root().to_str()?;
    let inside = place
        .strip_prefix(root)
        .map_or(place, |rest| rest.trim_start_matches('/'));
    let file = inside.split(':').next()?;
    file.starts_with("src/").then_some(file)
}

/// The library's frame that an address belongs to: the innermost, scalars and two-word sums aside, which are everybody's.
pub fn owner(frames: &[Frame]) -> Option<&Frame> {
    let ours = || frames.iter().filter(|frame| own(frame).is_some());
    let user = ours().find(|frame| own(frame).is_some_and(|file| !file.starts_with("src/linalg/")));
    user.or_else(|| ours().next())
}

/// Package of a place outside of the workspace.
pub fn package(place: &str) -> Option<&str> {
    if let Some((_, path)) = place.split_once("/library/") {
        return path.split('/').next();
    }
    // A package lies in a directory `name-version` of the registry.
    let directory = place.split('/').find(|part| {
        part.rsplit_once('-')
            .is_some_and(|(_, version)| version.starts_with(|c: char| c.is_ascii_digit()))
            && part.contains('.')
            && !part.contains("index")
    });
    Some(directory?.rsplit_once('-')?.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(place: &str) -> Frame {
        Frame {
            function: String::new(),
            place: place.to_owned(),
        }
    }

    #[test]
    fn inlined_code_belongs_to_the_line_of_the_library_that_led_to_it() {
        let root = shell::root().display();
        let nav = frame(&format!("{root}/src/nav.rs:70"));
        let two = frame(&format!("{root}/src/linalg/two.rs:9"));
        let core = frame("/usr/lib/rustlib/src/rust/library/core/src/ops/arith.rs:9");
        let example = frame(&format!("{root}/examples/bench.rs:1"));
        let file = |frames: &[Frame]| owner(frames).and_then(own).map(str::to_owned);
        assert_eq!(
            file(&[core.clone(), two.clone(), nav, example.clone()]).as_deref(),
            Some("src/nav.rs")
        );
        assert_eq!(
            file(&[core.clone(), two]).as_deref(),
            Some("src/linalg/two.rs")
        );
        assert_eq!(file(&[core, example]), None);
    }

    #[test]
    fn packages_are_known_by_their_directory() {
        assert_eq!(
            package("/usr/lib/rustlib/src/rust/library/core/src/fmt/num.rs:9"),
            Some("core")
        );
        assert_eq!(
            package("/home/a/registry/src/index.x-1949/libm-0.2.16/src/math/sinf.rs:3"),
            Some("libm")
        );
        assert_eq!(package("??:0"), None);
    }

    #[test]
    fn stacks_are_read_address_by_address() {
        let answer =
            "0x00000400\nReset\n??:?\n0x00000658\nsub\n/a.rs:1\nnavsight::nav::f\n/b.rs:2\n";
        let stacks = stacks(answer).unwrap();
        assert_eq!(stacks.len(), 2);
        assert_eq!((stacks[0].0, stacks[1].0), (0x400, 0x658));
        assert_eq!(stacks[1].1[1].function, "navsight::nav::f");
        assert_eq!(stacks[1].1[0].place, "/a.rs:1");
        assert!(super::stacks("Reset\n??:?\n").is_err());
    }
}
