//! Running other programs: output captured, time limited, and errors that show what the program said.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{bail, Context, Result};

/// The directory of the workspace.
pub fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .expect("xtask lies in the workspace")
}

/// Where cargo puts what it builds for the host.
pub fn target_dir() -> PathBuf {
    match std::env::var_os("CARGO_TARGET_DIR") {
        Some(dir) => root().join(dir),
        None => root().join("target"),
    }
}

/// A command of the project's own directory, without what an outer `cargo run` leaves in the environment: the inner
/// cargo shall find the same flags and toolchain as from a shell.
pub fn command(program: impl AsRef<std::ffi::OsStr>) -> Command {
    let mut command = Command::new(program);
    command.current_dir(root()).stdin(Stdio::null());
    for (name, _) in std::env::vars_os() {
        let name = name.to_string_lossy();
        let left_over = name.starts_with("CARGO_PKG_")
            || name.starts_with("CARGO_MANIFEST_")
            || name.starts_with("CARGO_BIN_");
        let steering = [
            "CARGO",
            "RUSTC",
            "RUSTDOC",
            "RUSTFLAGS",
            "RUSTDOCFLAGS",
            "CARGO_ENCODED_RUSTFLAGS",
            "CARGO_BUILD_TARGET",
        ];
        let toolchain = [
            "RUSTUP_TOOLCHAIN",
            "RUST_RECURSION_COUNT",
            "LD_LIBRARY_PATH",
            "RUSTC_BOOTSTRAP",
        ];
        if left_over || steering.contains(&&*name) || toolchain.contains(&&*name) {
            command.env_remove(&*name);
        }
    }
    command
}

/// What a program printed and how it ended.
pub struct Output {
    pub status: ExitStatus,
    pub stdout: String,
    pub stderr: String,
}

/// Runs a program to its end with its output captured; one that is still running after `limit` is ended and an error.
pub fn output(command: &mut Command, limit: Option<Duration>) -> Result<Output> {
    let shown = show(command);
    let mut child = command
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .with_context(|| format!("cannot start {shown}"))?;
    let stdout = drain(child.stdout.take());
    let stderr = drain(child.stderr.take());
    let status = wait(&mut child, limit);
    let collect = |reader: thread::JoinHandle<Vec<u8>>| {
        String::from_utf8_lossy(&reader.join().unwrap_or_default()).into_owned()
    };
    match status? {
        Some(status) => Ok(Output {
            status,
            stdout: collect(stdout),
            stderr: collect(stderr),
        }),
        None => bail!(
            "{shown} was still running after {:?}",
            limit.unwrap_or_default()
        ),
    }
}

/// Runs a program that has to succeed; returns its standard output. The error holds everything it printed.
pub fn run(command: &mut Command) -> Result<String> {
    let shown = show(command);
    let output = output(command, None)?;
    if !output.status.success() {
        bail!(
            "{shown}\n{}{}{}",
            output.stdout,
            output.stderr,
            output.status
        );
    }
    Ok(output.stdout)
}

/// The full path of a program on the search path.
pub fn find(program: &str) -> Option<PathBuf> {
    let path = std::env::var_os("PATH")?;
    std::env::split_paths(&path)
        .map(|dir| dir.join(program))
        .find(|file| file.is_file())
}

fn show(command: &Command) -> String {
    let words = std::iter::once(command.get_program()).chain(command.get_args());
    words
        .map(|word| word.to_string_lossy())
        .collect::<Vec<_>>()
        .join(" ")
}

fn drain(pipe: Option<impl Read + Send + 'static>) -> thread::JoinHandle<Vec<u8>> {
    thread::spawn(move || {
        let mut bytes = Vec::new();
        if let Some(mut pipe) = pipe {
            // A program that was ended half-way leaves what it wrote so far.
            let _ = pipe.read_to_end(&mut bytes);
        }
        bytes
    })
}

fn wait(child: &mut Child, limit: Option<Duration>) -> Result<Option<ExitStatus>> {
    let Some(limit) = limit else {
        return Ok(Some(child.wait()?));
    };
    let start = Instant::now();
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(Some(status));
        }
        if start.elapsed() > limit {
            child.kill()?;
            child.wait()?;
            return Ok(None);
        }
        thread::sleep(Duration::from_millis(10));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_that_never_ends_is_ended() {
        let start = Instant::now();
        let outcome = output(command("sleep").arg("60"), Some(Duration::from_millis(100)));
        assert!(outcome.is_err());
        assert!(start.elapsed() < Duration::from_secs(20));
    }

    #[test]
    fn an_error_shows_what_the_program_said() {
        let error =
            run(command("sh").args(["-c", "echo from stdout; echo from stderr >&2; exit 3"]))
                .unwrap_err();
        let text = format!("{error}");
        assert!(
            text.contains("from stdout") && text.contains("from stderr") && text.contains('3'),
            "{text}"
        );
    }
}
