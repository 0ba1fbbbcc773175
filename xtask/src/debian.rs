//! A bare-metal toolchain from Debian's packages, for machines whose rustup cannot bring the targets.
//!
//! `core` and `alloc` are compiled once per target from `rust-web-src` with the compiler of `rustc-web`, put into a
//! private sysroot, and the sysroot is linked into rustup as toolchain `thumb`: `cargo +thumb build --target …` then
//! works as it would anywhere, with clippy and rustdoc.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use anyhow::{bail, Context, Result};

use crate::{packages, shell, toolchain};

/// Name of the toolchain in rustup.
pub const NAME: &str = "thumb";

const RUSTC: &str = "/usr/bin/rustc";
const RUSTDOC: &str = "/usr/bin/rustdoc";
const CLIPPY: &str = "/usr/bin/cargo-clippy";
const CLIPPY_DRIVER: &str = "/usr/bin/clippy-driver";
const SOURCE: &str = "/usr/lib/rustlib/src/rust/library/core/src/lib.rs";

/// The private sysroot.
fn prefix() -> Result<PathBuf> {
    let cache = std::env::var_os("XDG_CACHE_HOME").map(PathBuf::from);
    let cache = cache.or_else(|| std::env::home_dir().map(|home| home.join(".cache")));
    Ok(cache.context("no home directory")?.join("thumb-toolchain"))
}

/// What identifies one build of the sysroot; differs after a rebuild with the same compiler, too.
pub fn stamp() -> Result<String> {
    let prefix = prefix()?;
    let mut stamp = fs::read_to_string(prefix.join("version"))?;
    for target in toolchain::TARGETS {
        let built =
            fs::metadata(prefix.join("lib/rustlib").join(target).join("lib"))?.modified()?;
        stamp += &format!(
            "{target} {:?}\n",
            built.duration_since(std::time::UNIX_EPOCH)?
        );
    }
    Ok(stamp)
}

/// Whether the sysroot was built with the compiler that is installed now.
pub fn current() -> bool {
    let version = shell::run(shell::command(RUSTC).arg("-vV"));
    let built = prefix().and_then(|prefix| Ok(fs::read_to_string(prefix.join("version"))?));
    matches!((version, built), (Ok(version), Ok(built)) if version == built)
}

/// Installs the packages, builds the sysroot for what it lacks, links it into rustup.
pub fn build(targets: &[&str]) -> Result<()> {
    packages::install(&missing_packages())?;
    let version = shell::run(shell::command(RUSTC).arg("-vV"))?;
    let prefix = prefix()?;
    fs::create_dir_all(&prefix)?;
    // Two checkouts may get here at the same time: the second one waits and finds everything done.
    let lock = File::create(prefix.join("lock"))?;
    lock.lock()?;

    if fs::read_to_string(prefix.join("version")).is_ok_and(|built| built != version) {
        fs::remove_dir_all(prefix.join("lib"))?;
    }
    let host = version
        .lines()
        .find_map(|line| line.strip_prefix("host: "))
        .context("host of rustc")?;
    let own = shell::run(shell::command(RUSTC).args(["--print", "sysroot"]))?;
    let rustlib = Path::new(own.trim()).join("lib/rustlib");
    let private = prefix.join("lib/rustlib").join(host);
    fs::create_dir_all(private.join("bin"))?;
    fs::create_dir_all(prefix.join("bin"))?;
    symlink(&rustlib.join(host).join("lib"), &private.join("lib"))?;
    symlink(&rustlib.join("src"), &prefix.join("lib/rustlib/src"))?;
    install_linker(host, &private.join("bin/rust-lld"))?;
    install_programs(&prefix)?;
    let lacking = |target: &&&str| !toolchain::has_core(&prefix, target);
    build_core(
        &prefix,
        &targets.iter().filter(lacking).copied().collect::<Vec<_>>(),
    )?;
    fs::write(prefix.join("version"), version)?;
    shell::run(
        shell::command("rustup")
            .args(["toolchain", "link", NAME])
            .arg(&prefix),
    )?;
    Ok(())
}

fn missing_packages() -> Vec<&'static str> {
    let needed = [
        (RUSTC, "rustc-web"),
        (SOURCE, "rust-web-src"),
        (CLIPPY, "rust-web-clippy"),
        // One installation for everything: apt takes its time.
        ("/usr/bin/qemu-system-arm", packages::QEMU.package),
        ("/usr/bin/arm-none-eabi-nm", packages::NM.package),
        ("/usr/bin/gcc", packages::GCC.package),
    ];
    needed
        .iter()
        .filter(|(file, _)| !Path::new(file).exists())
        .map(|&(_, package)| package)
        .collect()
}

/// rustup's own `rust-lld`, which lies beside its host `std`; else Debian's lld.
fn install_linker(host: &str, to: &Path) -> Result<()> {
    let active = shell::run(shell::command("rustc").args(["--print", "sysroot"]))?;
    let rust_lld = Path::new(active.trim())
        .join("lib/rustlib")
        .join(host)
        .join("bin/rust-lld");
    if rust_lld.exists() {
        return symlink(&rust_lld, to);
    }
    let lld = "/usr/bin/ld.lld-19";
    if !Path::new(lld).exists() {
        packages::install(&["lld-19"])?;
    }
    // rustc names the flavour as rust-lld wants it; ld.lld knows its own by its name.
    script(
        to,
        &format!("[ \"$1\" = -flavor ] && shift 2\nexec {lld} \"$@\"\n"),
    )
}

fn install_programs(prefix: &Path) -> Result<()> {
    let bin = prefix.join("bin");
    let sysroot = prefix.display();
    for (name, real) in [("rustc", RUSTC), ("rustdoc", RUSTDOC)] {
        let body = format!(
            "for a in \"$@\"; do case $a in --sysroot|--sysroot=*) exec {real} \"$@\";; esac; done\n\
             exec {real} \"$@\" --sysroot \"{sysroot}\"\n"
        );
        script(&bin.join(name), &body)?;
    }
    // cargo-clippy starts the driver beside its own real path, so the sysroot has to reach it by the environment.
    script(
        &bin.join("cargo-clippy"),
        &format!("export SYSROOT=\"{sysroot}\"\nexec {CLIPPY} \"$@\"\n"),
    )?;
    symlink(Path::new(CLIPPY_DRIVER), &bin.join("clippy-driver"))?;
    for name in ["cargo", "rustfmt", "cargo-fmt"] {
        if let Ok(real) = rustup_which(name) {
            symlink(&real, &bin.join(name))?;
        }
    }
    Ok(())
}

/// Builds `core` and `alloc` for all targets at once, since `core` is one long unit, and moves each into the sysroot in
/// one step.
fn build_core(prefix: &Path, targets: &[&str]) -> Result<()> {
    if targets.is_empty() {
        return Ok(());
    }
    let start = Instant::now();
    let seed = prefix.join("seed");
    if seed.exists() {
        fs::remove_dir_all(&seed)?;
    }
    fs::create_dir_all(seed.join("src"))?;
    fs::write(seed.join("src/lib.rs"), "#![no_std]\n")?;
    fs::write(
        seed.join("Cargo.toml"),
        "[package]\nname = \"sysroot-seed\"\nversion = \"0.0.0\"\nedition = \"2021\"\n\
         [profile.release]\nopt-level = 3\ncodegen-units = 1\ndebug = 1\n[workspace]\n",
    )?;
    let names = targets.join(", ");
    let mut cargo: Command = shell::command(rustup_which("cargo")?);
    cargo
        .current_dir(&seed)
        .env("RUSTC", RUSTC)
        // The standard library may only be built by a compiler that admits unstable features.
        .env("RUSTC_BOOTSTRAP", "1")
        // Without bitcode in the sysroot a firmware with `lto = true` does not link.
        .env("RUSTFLAGS", "-Cembed-bitcode=yes")
        .args(["build", "--release", "-Zbuild-std=core,alloc"])
        .args(targets.iter().flat_map(|target| ["--target", target]))
        .args(["--target-dir", "target"]);
    shell::run(&mut cargo).with_context(|| format!("core for {names}"))?;
    for target in targets {
        move_core(prefix, &seed, target)?;
    }
    fs::remove_dir_all(&seed)?;
    eprintln!("core for {names} in {:.0} s", start.elapsed().as_secs_f32());
    Ok(())
}

/// What was built for one target, into the sysroot.
fn move_core(prefix: &Path, seed: &Path, target: &str) -> Result<()> {
    let staged = seed.join(format!("staged-{target}"));
    fs::create_dir_all(&staged)?;
    let mut found = 0;
    for file in fs::read_dir(seed.join("target").join(target).join("release/deps"))? {
        let file = file?;
        let name = file.file_name().to_string_lossy().into_owned();
        let wanted = ["libcore-", "liballoc-", "libcompiler_builtins-"]
            .iter()
            .any(|start| name.starts_with(start));
        if wanted && name.ends_with(".rlib") {
            fs::copy(file.path(), staged.join(name))?;
            found += 1;
        }
    }
    if found != 3 {
        bail!("{found} libraries of three for {target}");
    }
    let place = prefix.join("lib/rustlib").join(target);
    fs::create_dir_all(&place)?;
    fs::rename(staged, place.join("lib"))?;
    Ok(())
}

fn rustup_which(program: &str) -> Result<PathBuf> {
    Ok(
        shell::run(shell::command("rustup").args(["which", program]))?
            .trim()
            .into(),
    )
}

fn symlink(real: &Path, link: &Path) -> Result<()> {
    if link.symlink_metadata().is_ok() {
        fs::remove_file(link)?;
    }
    #[cfg(unix)]
    std::os::unix::fs::symlink(real, link)?;
    #[cfg(not(unix))]
    bail!(
        "{} → {}: the Debian route needs a Unix",
        link.display(),
        real.display()
    );
    Ok(())
}

fn script(file: &Path, body: &str) -> Result<()> {
    if file.symlink_metadata().is_ok() {
        fs::remove_file(file)?;
    }
    fs::write(file, format!("#!/bin/sh\n{body}"))?;
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        fs::set_permissions(file, fs::Permissions::from_mode(0o755))?;
    }
    Ok(())
}
