//! Recorded data: comma-separated text in, checked numbers out, or one line that says what is wrong and where.
//!
//! A file is read line by line and never held in memory, and neither is a line that does not end: [`MAX_LINE`] bytes
//! are the most that is ever taken in. The format is kept plain on purpose (no line breaks inside quotes), so that a
//! line number in a message is the line number in an editor.
//!
//! | file | reader | columns, in any order; others are ignored |
//! |---|---|---|
//! | `imu.csv` | [`ImuReader`] | `t_s`, then `dtheta_x,y,z` [rad] and `dvel_x,y,z` [m/s], or `gyro_x,y,z` [rad/s] and `acc_x,y,z` [m/s²] |
//! | `gnss.csv` | [`gnss::read`] | `t_s`, `lat_deg`, `lon_deg`, `height_m`, and `v_e`, `v_n`, `v_u` [m/s] where known |
//! | `ref.csv` | [`reference::read`] | `t_s`, `qw`, `qx`, `qy`, `qz` (body to local frame, z up); `nan` where it is missing |
//! | `rest.csv` | [`rest::read`] | `t_s`, `at_rest` (0 or 1) |
//!
//! Lines that start with `#` are notes, empty lines are skipped.

pub mod axes;
pub mod gnss;
pub mod imu;
pub mod reference;
pub mod rest;

pub use axes::Axes;
pub use imu::{ImuReader, ImuSample};

use crate::lab::LabError;
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Longest line that is read, in bytes. A row of numbers has a few hundred.
pub const MAX_LINE: usize = 64 * 1024;

/// A quotation of damaged input that is safe to print: one line, printable, short.
fn quote(bytes: &[u8]) -> String {
    const SHOWN: usize = 32;
    let head = &bytes[..bytes.len().min(SHOWN)];
    let more = if bytes.len() > SHOWN { "…" } else { "" };
    format!("\"{}\"{more}", head.escape_ascii())
}

/// One column that a reader has asked for.
#[derive(Clone, Copy, Debug)]
pub struct Column(usize);

/// A table with a header line, read row by row.
pub struct Table<R> {
    file: PathBuf,
    source: R,
    /// Number of the line in `text`, from 1.
    line: usize,
    /// The current line, without its end.
    text: Vec<u8>,
    /// The fields of the current line, trimmed.
    fields: Vec<Range<usize>>,
    header: Vec<String>,
    header_line: usize,
    /// The last line has been read.
    over: bool,
    bytes: u64,
}

impl Table<BufReader<File>> {
    /// Opens a file and reads its header.
    pub fn open(path: &Path) -> Result<Self, LabError> {
        let unreadable =
            |e: std::io::Error| LabError::in_file(path, format!("cannot be read: {e}"));
        let file = File::open(path).map_err(unreadable)?;
        if file.metadata().map_err(unreadable)?.is_dir() {
            return Err(LabError::in_file(path, "is a folder"));
        }
        Self::new(path, BufReader::with_capacity(MAX_LINE, file))
    }
}

impl<R: BufRead> Table<R> {
    /// Reads the header from any source; `name` is what messages call it.
    pub fn new(name: &Path, source: R) -> Result<Self, LabError> {
        let mut table = Self {
            file: name.to_path_buf(),
            source,
            line: 0,
            text: Vec::new(),
            fields: Vec::new(),
            header: Vec::new(),
            header_line: 0,
            over: false,
            bytes: 0,
        };
        if !table.next_line()? {
            return Err(table.refused_at("t_s", "the file is empty: no header line"));
        }
        let header: Vec<String> = table
            .fields
            .iter()
            .map(|r| String::from_utf8_lossy(&table.text[r.clone()]).into_owned())
            .collect();
        for (i, name) in header.iter().enumerate() {
            if name.is_empty() || !name.chars().all(|c| c.is_ascii_graphic() || c == ' ') {
                let shown = quote(name.as_bytes());
                return Err(table.refused_at(
                    &format!("field {}", i + 1),
                    &format!("{shown} is not a column name"),
                ));
            }
            if header[..i].contains(name) {
                return Err(table.refused_at(name, "this column stands twice in the header"));
            }
        }
        table.header_line = table.line;
        table.header = header;
        Ok(table)
    }

    /// File name for messages.
    pub fn file(&self) -> &Path {
        &self.file
    }

    /// A column by name, if the file has it.
    pub fn find(&self, name: &str) -> Option<Column> {
        self.header.iter().position(|h| h == name).map(Column)
    }

    /// A column that the file must have.
    pub fn require(&self, name: &str) -> Result<Column, LabError> {
        self.find(name)
            .ok_or_else(|| self.at(self.header_line, name, "the header has no such column"))
    }

    /// Several columns that the file must have.
    pub fn require_all<const K: usize>(&self, names: [&str; K]) -> Result<[Column; K], LabError> {
        let mut columns = [Column(0); K];
        for (column, name) in columns.iter_mut().zip(names) {
            *column = self.require(name)?;
        }
        Ok(columns)
    }

    /// Bytes read so far.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Moves to the next row of data. `false`: the file is over.
    pub fn next_row(&mut self) -> Result<bool, LabError> {
        if !self.next_line()? {
            return Ok(false);
        }
        let (got, want) = (self.fields.len(), self.header.len());
        if got < want {
            let field = self.header[got].clone();
            return Err(self.refused_at(
                &field,
                &format!("missing: the line has {got} fields, the header {want}"),
            ));
        }
        if got > want {
            return Err(self.refused_at(
                &format!("field {}", want + 1),
                &format!("too many: the line has {got} fields, the header {want}"),
            ));
        }
        Ok(true)
    }

    /// A finite number of the current row.
    pub fn number(&self, column: Column) -> Result<f64, LabError> {
        let value = self.number_or_nan(column)?;
        if value.is_nan() {
            return Err(self.refused(column, "is not a number (NaN)"));
        }
        Ok(value)
    }

    /// A number of the current row that may be missing (`nan`), never infinite.
    pub fn number_or_nan(&self, column: Column) -> Result<f64, LabError> {
        let text = &self.text[self.fields[column.0].clone()];
        if text.is_empty() {
            return Err(self.refused(column, "is empty"));
        }
        let value = std::str::from_utf8(text)
            .ok()
            .and_then(|s| s.parse::<f64>().ok());
        match value {
            None => Err(self.refused(column, &format!("{} is not a number", quote(text)))),
            Some(v) if v.is_infinite() => {
                Err(self.refused(column, &format!("{} is not finite", quote(text))))
            }
            Some(v) => Ok(v),
        }
    }

    /// Three finite numbers.
    pub fn numbers<const K: usize>(&self, columns: [Column; K]) -> Result<[f64; K], LabError> {
        let mut values = [0.0; K];
        for (value, column) in values.iter_mut().zip(columns) {
            *value = self.number(column)?;
        }
        Ok(values)
    }

    /// Refuses a value of the current row.
    pub fn refused(&self, column: Column, what: &str) -> LabError {
        let name = self.header[column.0].clone();
        self.refused_at(&name, what)
    }

    /// Number of the current line.
    pub fn line(&self) -> usize {
        self.line
    }

    fn refused_at(&self, field: &str, what: &str) -> LabError {
        self.at(self.line, field, what)
    }

    fn at(&self, line: usize, field: &str, what: &str) -> LabError {
        LabError::in_file(&self.file, what).line(line).field(field)
    }

    /// Name of the field in which the text read so far ends.
    fn open_field(&self) -> String {
        let i = self.text.iter().filter(|&&b| b == b',').count();
        self.header
            .get(i)
            .cloned()
            .unwrap_or_else(|| format!("field {}", i + 1))
    }

    /// Reads the next line that is neither empty nor a note, and splits it.
    fn next_line(&mut self) -> Result<bool, LabError> {
        if self.over {
            return Ok(false);
        }
        loop {
            self.line += 1;
            self.text.clear();
            let whole = match self.read_bounded() {
                Ok(whole) => whole,
                Err(e) => {
                    return Err(self.refused_at(&self.open_field(), &format!("cannot be read: {e}")))
                }
            };
            if self.text.len() > MAX_LINE {
                let field = self.open_field();
                return Err(
                    self.refused_at(&field, &format!("the line is longer than {MAX_LINE} bytes"))
                );
            }
            self.over = !whole;
            if self.text.is_empty() && self.over {
                return Ok(false);
            }
            if self.line == 1 && self.text.starts_with(b"\xef\xbb\xbf") {
                self.text.drain(..3); // byte-order mark of some editors
            }
            let text = self.text.trim_ascii();
            if text.is_empty() || text.starts_with(b"#") {
                if whole {
                    continue;
                }
                return Ok(false);
            }
            if !whole {
                let field = self.open_field();
                return Err(self.refused_at(
                    &field,
                    "the file ends inside this line: cut off? (a complete file ends with a line break)",
                ));
            }
            self.split();
            return Ok(true);
        }
    }

    /// Appends up to the next line break, or just over [`MAX_LINE`] bytes. `true`: the line break was there.
    fn read_bounded(&mut self) -> std::io::Result<bool> {
        loop {
            let chunk = match self.source.fill_buf() {
                Err(e) if e.kind() == std::io::ErrorKind::Interrupted => continue,
                other => other?,
            };
            if chunk.is_empty() {
                return Ok(false);
            }
            let end = chunk.iter().position(|&b| b == b'\n');
            let room = MAX_LINE + 1 - self.text.len();
            let take = end.unwrap_or(chunk.len()).min(room);
            self.text.extend_from_slice(&chunk[..take]);
            let found = end == Some(take);
            let used = if found { take + 1 } else { take };
            self.source.consume(used);
            self.bytes += used as u64;
            if found || self.text.len() > MAX_LINE {
                return Ok(found);
            }
        }
    }

    /// Finds the fields of `text`: between commas, without spaces and without quotes around them.
    fn split(&mut self) {
        self.fields.clear();
        let mut start = 0;
        for piece in self.text.split(|&b| b == b',') {
            let inner = piece.trim_ascii();
            let inner = match inner {
                [b'"', middle @ .., b'"'] => middle,
                plain => plain,
            };
            let from = start + (inner.as_ptr() as usize - piece.as_ptr() as usize);
            self.fields.push(from..from + inner.len());
            start += piece.len() + 1;
        }
    }
}

/// Time that must go forward.
#[derive(Clone, Copy, Debug, Default)]
struct Clock {
    last: Option<f64>,
}

impl Clock {
    fn tick<R: BufRead>(&mut self, table: &Table<R>, column: Column) -> Result<f64, LabError> {
        let t = table.number(column)?;
        if let Some(last) = self.last.filter(|&last| t <= last) {
            let how = if t < last {
                "goes back"
            } else {
                "stands still"
            };
            return Err(table.refused(column, &format!("time {how}: {t} s after {last} s")));
        }
        self.last = Some(t);
        Ok(t)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Read;

    fn rows(text: &str) -> Result<Vec<f64>, LabError> {
        let mut table = Table::new(Path::new("f.csv"), text.as_bytes())?;
        let column = table.require("a")?;
        let mut values = Vec::new();
        while table.next_row()? {
            values.push(table.number(column)?);
        }
        Ok(values)
    }

    #[test]
    fn order_notes_blank_lines_quotes_and_line_ends_do_not_matter() {
        assert_eq!(
            rows("# note\n\nb, a\n1,2\n# more\n\n 3 ,\t4 \n"),
            Ok(vec![2.0, 4.0])
        );
        assert_eq!(
            rows("\u{feff}\"b\",\"a\"\r\n1,2e1\r\n1,+.5\r\n"),
            Ok(vec![20.0, 0.5])
        );
        assert_eq!(rows("a\n1\n# note at the very end"), Ok(vec![1.0]));
    }

    #[test]
    fn a_message_carries_the_line_an_editor_shows() {
        let refused = rows("# note\n\na,b\n1,2\n\n# note\n1x,2\n").unwrap_err();
        assert_eq!(refused.to_string(), "f.csv:7: a: \"1x\" is not a number");
    }

    #[test]
    fn a_line_without_end_is_refused_after_a_bounded_read() {
        struct Endless {
            given: usize,
        }
        impl Read for Endless {
            fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
                out.fill(b'7');
                self.given += out.len();
                assert!(self.given <= 4 * MAX_LINE, "read on and on");
                Ok(out.len())
            }
        }
        let source = b"a,b\n"
            .as_slice()
            .chain(BufReader::new(Endless { given: 0 }));
        let mut table = Table::new(Path::new("f.csv"), source).unwrap();
        let refused = table.next_row().unwrap_err();
        assert_eq!(
            (refused.line, refused.field.as_deref()),
            (Some(2), Some("a"))
        );
        assert!(table.text.capacity() <= 4 * MAX_LINE);
    }

    #[test]
    fn a_longest_line_still_passes() {
        let pad = " ".repeat(MAX_LINE - 1);
        assert_eq!(rows(&format!("a\n{pad}5\n")), Ok(vec![5.0]));
        assert!(rows(&format!("a\n {pad}5\n")).is_err());
    }
}
