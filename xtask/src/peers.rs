//! `cargo xtask peers`: other filters beside ours on the same work, counted in the same harness; writes the table of
//! BENCHMARKS.md. Not part of any check: it builds packages that nothing else needs.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::process::ExitCode;

use anyhow::{bail, Context, Result};

use crate::bench::{self, grouped};
use crate::toolchain::{self, target_dir, THUMBV7EM};
use crate::{packages, qemu, shell};

/// What the firmware prints and the plugin counts of one peer.
struct Peer {
    name: String,
    scalar: String,
    kind: String,
    bytes: u64,
    /// Instructions and stack of a sample, of one that moves the covariance, and of an update.
    counts: Vec<(u64, u64)>,
}

pub fn run() -> Result<ExitCode> {
    let toolchain = toolchain::ready()?;
    packages::ready(&[packages::QEMU])?;
    let folder = shell::root().join("bench-peers");
    let out = target_dir().join("peers");

    let mut host = shell::command("cargo");
    host.args(["run", "--release", "--quiet"])
        .current_dir(&folder)
        .env("CARGO_TARGET_DIR", &out);
    let results = shell::run(&mut host).context("the peers on the host")?;

    let mut cargo = toolchain.cargo("build");
    cargo
        .args(["--release", "--target", THUMBV7EM])
        .current_dir(&folder)
        .env("CARGO_TARGET_DIR", &out);
    shell::run(&mut cargo).context("the peers as firmware")?;
    let elf = out.join(THUMBV7EM).join("release/bench-peers");
    let counts = out.join("counts.txt");
    let plugin = bench::plugin()?;
    let plugin = format!("{},out={}", plugin.display(), counts.display());
    let printed = qemu::run_on(qemu::M4F, &elf, &["-plugin", &plugin])?;
    let peers = pair(&printed, &fs::read_to_string(counts)?)?;
    let text = format!(
        "rustc {}, opt-level 3, fat LTO, no CPU flag; Cortex-M4F, QEMU {}.\n\n{}",
        toolchain.release,
        qemu::version()?,
        table(&peers, &results)
    );
    println!("{text}");
    bench::record("peers", &text)?;
    bench::write_figures()?;
    Ok(ExitCode::SUCCESS)
}

/// Joins names and counts, both in order.
fn pair(printed: &str, counts: &str) -> Result<Vec<Peer>> {
    let mut counts = counts.lines().map(bench::count);
    let mut next = || counts.next().context("a count for every row")?;
    let mut peers: Vec<Peer> = Vec::new();
    let mut empty = 0;
    for line in printed.lines() {
        let fields: Vec<&str> = line.split('\t').collect();
        match fields[..] {
            ["row", "empty", ..] => empty = next()?.0,
            ["row", "calibration", ..] => {
                let (instructions, _) = next()?;
                if instructions != empty + 103 {
                    bail!("103 instructions were counted as {}", instructions - empty);
                }
            }
            ["peer", name, scalar, kind, bytes] => peers.push(Peer {
                name: name.to_owned(),
                scalar: scalar.to_owned(),
                kind: kind.to_owned(),
                bytes: bytes.parse()?,
                counts: Vec::new(),
            }),
            ["row", name, work, done, ..] => {
                let (instructions, stack) = next()?;
                if done != "true" {
                    bail!("{name} refused: {work}");
                }
                let peer = peers.last_mut().context("a line `peer` before its rows")?;
                peer.counts.push((instructions - empty, stack));
            }
            _ => {}
        }
    }
    Ok(peers)
}

fn table(peers: &[Peer], results: &str) -> String {
    let results: BTreeMap<&str, Vec<&str>> = results
        .lines()
        .filter_map(|line| line.strip_prefix("result\t"))
        .filter_map(|line| line.split_once('\t'))
        .map(|(name, rest)| (name, rest.split('\t').collect()))
        .collect();
    let mut text = String::from(
        "| filter | scalar | IMU sample | sample that moves P | three-row update | instructions/s at 100 Hz, update 10 Hz \
         | deepest stack [B] | object [B] | σ of velocity after 60 s [mm/s] | heading error [°] | tilt error [°] |\n\
         |---|---|---|---|---|---|---|---|---|---|---|\n",
    );
    for peer in peers {
        let [sample, moving, update] = peer.counts[..] else {
            continue;
        };
        // a filter that moves its covariance with every sample pays for it every time
        let moves = if sample.0 * 2 < moving.0 { 10 } else { 100 };
        let load = sample.0 * (100 - moves) + moving.0 * moves + update.0 * 10;
        let stack = [sample.1, moving.1, update.1].into_iter().max();
        let none = Vec::new();
        let result = results.get(peer.name.as_str()).unwrap_or(&none);
        let number = |i: usize| result.get(i).and_then(|x: &&str| x.parse::<f64>().ok());
        let shown = |x: Option<f64>, digits: usize| {
            x.map_or_else(|| "—".to_owned(), |x| format!("{x:.digits$}"))
        };
        let mark = if peer.kind == "algebra" { " *" } else { "" };
        writeln!(
            text,
            "| {}{mark} | {} | {} | {} | {} | {} | {} | {} | {} | {} | {} |",
            peer.name,
            peer.scalar,
            grouped(sample.0),
            grouped(moving.0),
            grouped(update.0),
            grouped(load),
            grouped(stack.unwrap_or(0)),
            grouped(peer.bytes),
            shown(number(0).map(|v| 1e3 * v.sqrt()), 2),
            shown(number(1), 3),
            shown(number(2), 4),
        )
        .unwrap_or_default();
    }
    text += "\n\\* linear algebra only: it is handed Φ, Q, H and R, which cost nothing here, and knows no navigation; its \
             object holds these matrices (minikalman's are on the heap beside it).";
    text
}
