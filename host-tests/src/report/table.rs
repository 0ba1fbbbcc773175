//! A table with two faces: text for a terminal, HTML for a report.

use super::page::{escape, Tone};

/// One cell.
#[derive(Clone, Debug, PartialEq)]
pub struct Cell {
    text: String,
    tone: Tone,
}

impl Cell {
    /// A cell that stands out.
    pub fn toned(text: impl Into<String>, tone: Tone) -> Self {
        Self {
            text: text.into(),
            tone,
        }
    }
}

impl<S: Into<String>> From<S> for Cell {
    fn from(text: S) -> Self {
        Self::toned(text, Tone::Plain)
    }
}

/// Headings and rows. The first column is text and stands left, the others are numbers and stand right.
#[derive(Clone, Debug, Default)]
pub struct Table {
    caption: String,
    /// Heading over several columns and how many.
    groups: Vec<(String, usize)>,
    headings: Vec<String>,
    rows: Vec<Vec<Cell>>,
}

impl Table {
    /// An empty table.
    pub fn new<S: Into<String>>(
        caption: impl Into<String>,
        headings: impl IntoIterator<Item = S>,
    ) -> Self {
        Self {
            caption: caption.into(),
            headings: headings.into_iter().map(Into::into).collect(),
            ..Self::default()
        }
    }

    /// Headings above the headings: text and number of columns.
    pub fn groups<S: Into<String>>(mut self, groups: impl IntoIterator<Item = (S, usize)>) -> Self {
        self.groups = groups.into_iter().map(|(s, n)| (s.into(), n)).collect();
        self
    }

    /// Adds a row.
    pub fn row<C: Into<Cell>>(&mut self, cells: impl IntoIterator<Item = C>) {
        self.rows.push(cells.into_iter().map(Into::into).collect());
    }

    /// Lines for a terminal, columns aligned.
    pub fn to_text(&self) -> String {
        let width = |s: &str| s.chars().count();
        let mut widths: Vec<usize> = self.headings.iter().map(|h| width(h)).collect();
        for row in &self.rows {
            for (w, cell) in widths.iter_mut().zip(row) {
                *w = (*w).max(width(&cell.text));
            }
        }
        // A heading over several columns may need more room than they have.
        let mut from = 0;
        for (text, span) in &self.groups {
            let columns = &mut widths[from..from + span];
            let have = columns.iter().sum::<usize>() + 2 * (span - 1);
            if let Some(last) = columns.last_mut() {
                *last += width(text).saturating_sub(have);
            }
            from += span;
        }
        let mut lines = vec![self.caption.clone()];
        let pad = |n: usize| " ".repeat(n);
        if !self.groups.is_empty() {
            let (mut line, mut from) = (String::new(), 0);
            for (text, span) in &self.groups {
                let room = widths[from..from + span].iter().sum::<usize>() + 2 * (span - 1);
                let free = room - width(text);
                let left = if from == 0 { 0 } else { free };
                line += &format!("{}{text}{}  ", pad(left), pad(free - left));
                from += span;
            }
            lines.push(line);
        }
        let aligned = |texts: Vec<&str>| {
            let mut line = String::new();
            for (i, (text, w)) in texts.iter().zip(&widths).enumerate() {
                let free = pad(w - width(text));
                line += &if i == 0 {
                    format!("{text}{free}  ")
                } else {
                    format!("{free}{text}  ")
                };
            }
            line
        };
        lines.push(aligned(self.headings.iter().map(String::as_str).collect()));
        let rule = widths.iter().sum::<usize>() + 2 * widths.len().saturating_sub(1);
        lines.push("─".repeat(rule));
        for row in &self.rows {
            lines.push(aligned(row.iter().map(|c| c.text.as_str()).collect()));
        }
        lines
            .iter()
            .map(|line| format!("{}\n", line.trim_end()))
            .collect()
    }

    /// An HTML table.
    pub fn to_html(&self) -> String {
        let mut html = format!(
            "<div class=\"scroll\"><table><caption>{}</caption><thead>",
            escape(&self.caption)
        );
        if !self.groups.is_empty() {
            html += "<tr>";
            for (text, span) in &self.groups {
                html += &format!(
                    "<th class=\"group\" colspan=\"{span}\">{}</th>",
                    escape(text)
                );
            }
            html += "</tr>";
        }
        html += "<tr>";
        for heading in &self.headings {
            html += &format!("<th>{}</th>", escape(heading));
        }
        html += "</tr></thead><tbody>\n";
        for row in &self.rows {
            html += "<tr>";
            for cell in row {
                html += &format!(
                    "<td class=\"{}\">{}</td>",
                    cell.tone.class(),
                    escape(&cell.text)
                );
            }
            html += "</tr>\n";
        }
        html + "</tbody></table></div>\n"
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_line_up_under_their_headings() {
        let mut table =
            Table::new("Made up", ["state", "ξ1", "ξ2"]).groups([("", 1), ("a longer heading", 2)]);
        table.row(["heading", "1.5", "400"]);
        table.row(["height", "22", "7"]);
        assert_eq!(
            table.to_text(),
            "Made up\n         a longer heading\nstate     ξ1           ξ2\n\
             ─────────────────────────\nheading  1.5          400\nheight    22            7\n"
        );
    }
}
