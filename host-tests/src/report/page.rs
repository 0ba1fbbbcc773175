//! One HTML file: text, tables and pictures, nothing fetched from anywhere.

use std::fs;
use std::path::{Path, PathBuf};

use super::Table;
use crate::lab::LabError;

/// How a sentence or a cell is meant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tone {
    /// Nothing special.
    Plain,
    /// As hoped.
    Good,
    /// Worth a look.
    Note,
    /// Not as hoped.
    Bad,
}

impl Tone {
    pub(super) fn class(self) -> &'static str {
        match self {
            Tone::Plain => "plain",
            Tone::Good => "good",
            Tone::Note => "note",
            Tone::Bad => "bad",
        }
    }
}

/// Text made safe inside HTML.
pub(super) fn escape(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}

/// A page that grows from top to bottom.
pub struct Page {
    title: String,
    body: String,
}

const STYLE: &str = include_str!("page.css");

impl Page {
    /// A page with its title and a sentence that says what it is about.
    pub fn new(title: &str, lead: &str) -> Self {
        let (t, l) = (escape(title), escape(lead));
        Self {
            title: title.to_owned(),
            body: format!("<header><h1>{t}</h1><p>{l}</p></header>\n"),
        }
    }

    /// A heading.
    pub fn section(&mut self, heading: &str) {
        self.body += &format!("<h2>{}</h2>\n", escape(heading));
    }

    /// A paragraph.
    pub fn text(&mut self, text: &str) {
        self.body += &format!("<p>{}</p>\n", escape(text));
    }

    /// A question of the reader and its answer in a sentence.
    pub fn verdict(&mut self, tone: Tone, question: &str, answer: &str) {
        let (class, q, a) = (tone.class(), escape(question), escape(answer));
        self.body +=
            &format!("<div class=\"verdict {class}\"><strong>{q}</strong><span>{a}</span></div>\n");
    }

    /// A table.
    pub fn table(&mut self, table: &Table) {
        self.body += &table.to_html();
    }

    /// Pictures side by side, `columns` of them in a row, with one caption below.
    pub fn figures(&mut self, columns: usize, pictures: &[String], caption: &str) {
        self.body += &format!("<figure><div class=\"grid of{columns}\">");
        for svg in pictures {
            self.body += &format!("<div class=\"panel\">{svg}</div>\n");
        }
        self.body += &format!(
            "</div><figcaption>{}</figcaption></figure>\n",
            escape(caption)
        );
    }

    /// A key of colours for the pictures below.
    pub fn key(&mut self, entries: &[(&str, &str)]) {
        self.body += "<p class=\"key\">";
        for (color, text) in entries {
            let text = escape(text);
            self.body += &format!("<span><i style=\"background:{color}\"></i>{text}</span>");
        }
        self.body += "</p>\n";
    }

    /// The whole file.
    pub fn to_html(&self) -> String {
        format!(
            "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\
             <title>{}</title><style>{STYLE}</style></head>\n<body><main>\n{}</main></body></html>\n",
            escape(&self.title),
            self.body
        )
    }

    /// Writes `report.html` into a folder, which is made if need be, and returns its path.
    pub fn write(&self, folder: &Path) -> Result<PathBuf, LabError> {
        let path = folder.join("report.html");
        write_file(&path, &self.to_html())?;
        Ok(path)
    }
}

/// Writes a file into a folder, which is made if need be.
pub fn write_file(path: &Path, text: &str) -> Result<(), LabError> {
    path.parent()
        .map_or(Ok(()), fs::create_dir_all)
        .and_then(|()| fs::write(path, text))
        .map_err(|e| LabError::in_file(path, format!("cannot be written: {e}")))
}
