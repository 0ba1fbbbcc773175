//! Why the work of an example ended early.

use core::fmt::Write;

use navsight::error::Error;

/// Nothing to print to, or refused.
pub enum Stop {
    Output,
    Refused(Error),
}

impl From<core::fmt::Error> for Stop {
    fn from(_: core::fmt::Error) -> Self {
        Self::Output
    }
}

impl From<Error> for Stop {
    fn from(error: Error) -> Self {
        Self::Refused(error)
    }
}

/// Says a refusal where everything else was said.
pub fn said(out: &mut impl Write, outcome: Result<(), Stop>) -> core::fmt::Result {
    match outcome {
        Ok(()) => Ok(()),
        Err(Stop::Output) => Err(core::fmt::Error),
        Err(Stop::Refused(error)) => writeln!(out, "the filter refused: {error:?}"),
    }
}
