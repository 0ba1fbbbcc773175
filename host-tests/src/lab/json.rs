//! JSON input files: where exactly one is wrong.

use std::fs;
use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;

use super::LabError;

/// A file that was read, kept to tell lines.
pub struct Source {
    path: PathBuf,
    text: String,
}

/// Reads a file; what cannot be read is told with line and field.
pub fn read<T: DeserializeOwned>(path: &Path) -> Result<(T, Source), LabError> {
    let text =
        fs::read_to_string(path).map_err(|error| LabError::in_file(path, error.to_string()))?;
    let mut json = serde_json::Deserializer::from_str(&text);
    let value: T = serde_path_to_error::deserialize(&mut json).map_err(|error| {
        let field = error.path().to_string();
        let line = error.inner().line();
        let located = LabError::in_file(path, error.inner().to_string()).line(line.max(1));
        if field == "." {
            located
        } else {
            located.field(field)
        }
    })?;
    json.end()
        .map_err(|error| LabError::in_file(path, error.to_string()).line(error.line()))?;
    Ok((
        value,
        Source {
            path: path.to_path_buf(),
            text,
        },
    ))
}

impl Source {
    /// A value that is read and makes no sense; `key` is looked for as the line.
    pub fn wrong(&self, key: &str, field: impl Into<String>, what: impl Into<String>) -> LabError {
        let quoted = format!("\"{key}\"");
        let line = self.text.lines().position(|l| l.contains(&quoted));
        LabError::in_file(&self.path, what)
            .line(line.map_or(1, |l| l + 1))
            .field(field)
    }
}
