use crate::{report::Report, toolchain::Toolchain};
pub fn run(_json: bool, _accept: bool) -> anyhow::Result<std::process::ExitCode> {
    Ok(std::process::ExitCode::SUCCESS)
}
pub fn check(_: &mut Report, _: &Toolchain) {}
