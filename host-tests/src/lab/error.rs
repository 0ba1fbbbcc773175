//! Why a command of the lab stopped, in one line.

use std::fmt;
use std::path::{Path, PathBuf};

/// Why a command stopped. `Display` is one line: file, line, field where they are known, then what is wrong.
#[derive(Clone, Debug, PartialEq)]
pub struct LabError {
    /// The file at fault.
    pub file: Option<PathBuf>,
    /// Line in it, from 1.
    pub line: Option<usize>,
    /// Field, column or flag at fault.
    pub field: Option<String>,
    /// What is wrong with it.
    pub what: String,
}

impl LabError {
    /// A failure that belongs to no file.
    pub fn plain(what: impl Into<String>) -> Self {
        Self {
            file: None,
            line: None,
            field: None,
            what: what.into(),
        }
    }

    /// A failure in `file`.
    pub fn in_file(file: &Path, what: impl Into<String>) -> Self {
        Self {
            file: Some(file.to_path_buf()),
            ..Self::plain(what)
        }
    }

    /// At this line, from 1.
    pub fn line(self, line: usize) -> Self {
        Self {
            line: Some(line),
            ..self
        }
    }

    /// In this field, column or flag.
    pub fn field(self, field: impl Into<String>) -> Self {
        Self {
            field: Some(field.into()),
            ..self
        }
    }

    /// What the argument parser found, without its usage lines.
    pub fn command_line(error: &clap::Error) -> Self {
        let text = error.to_string();
        let first: Vec<&str> = text
            .lines()
            .map(str::trim)
            .take_while(|line| !line.is_empty())
            .collect();
        let first = first.join(" ");
        match first.strip_prefix("error: ") {
            Some(what) => Self::plain(what),
            // No command at all: the parser prints its help as the error.
            None => Self::plain("a command is needed; `cargo lab --help` lists them"),
        }
    }
}

impl fmt::Display for LabError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(file) = &self.file {
            write!(f, "{}", file.display())?;
            if let Some(line) = self.line {
                write!(f, ":{line}")?;
            }
            write!(f, ": ")?;
        }
        if let Some(field) = &self.field {
            write!(f, "{}: ", one_line(field))?;
        }
        write!(f, "{}", one_line(&self.what))
    }
}

impl std::error::Error for LabError {}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}
