//! The table of costs in the README: figures of BENCHMARKS.md and nothing else, so that the two cannot differ.

use std::fs;

use anyhow::{Context, Result};

use super::table::{record_in, section};
use crate::shell;

/// Who is beside us, and our lines of that table.
const PEER: &str = "fusion-nav";
const OURS: [&str; 2] = [
    "navsight, covariance at every sample",
    "navsight, covariance at 10 Hz",
];

/// Writes the table again; whoever changes BENCHMARKS.md calls this.
pub fn write() -> Result<()> {
    let page = fs::read_to_string(shell::root().join("BENCHMARKS.md"))?;
    record_in("README.md", "bench", &text(&page)?)
}

/// The table, from the text of BENCHMARKS.md.
fn text(page: &str) -> Result<String> {
    let (_, bench, _) = section(page, "bench")?;
    let (_, peers, _) = section(page, "peers")?;
    let (_, size, _) = section(page, "size")?;
    // instructions stand before the stack in the column of opt-level 3
    let count =
        |work: &str| cell(bench, work, 2).map(|cell| cell.split(" / ").next().unwrap_or(cell));
    let number = |row: &str, column: usize| -> Result<f64> {
        let text = cell(peers, row, column)?.replace(',', "");
        Ok(text.parse()?)
    };
    let peer = peers
        .lines()
        .filter_map(|line| line.strip_prefix("| ")?.split(" | ").next())
        .find(|name| name.starts_with(PEER))
        .context("the peer")?;
    let [every_sample, usual] = OURS;
    let times = |ours: &str, column: usize| -> Result<f64> {
        Ok(number(peer, column)? / number(ours, column)?)
    };
    let lines = [
        (
            "IMU sample, coning and sculling, long-run exact",
            count("IMU sample through the filter")?.to_owned(),
        ),
        (
            "covariance over an interval",
            count("covariance propagation")?.to_owned(),
        ),
        (
            "three velocity rows with gates, correction, ξ1 and ξ2 of 15 states",
            count("three-row velocity update with ξ1 and ξ2")?.to_owned(),
        ),
        (
            "all 15 eigenvalues of η2; the dearest slice of them",
            format!(
                "{}; {}",
                count("full η2 spectrum, values")?,
                count("one slice of an η spectrum")?
            ),
        ),
        (
            "ranking of six manoeuvres over 300 s, in slices",
            count("planner: ranking of six manoeuvres over 300 s")?.to_owned(),
        ),
        (
            "filter object, with all that ξ needs [bytes of RAM]",
            cell(bench, "`Filter`", 1)?.to_owned(),
        ),
    ];
    let mut text =
        "| on a Cortex-M4F, f32, opt-level 3 | instructions | command |\n|---|---|---|".to_owned();
    let mut command = "`cargo xtask bench`";
    for (what, figure) in lines {
        text += &format!("\n| {what} | {figure} | {command} |");
        command = "";
    }
    text += &format!(
        "\n| firmware with no more than mechanization, covariance, zero-velocity updates and ξ [bytes of flash] | {} | `cargo \
         xtask size` |",
        cell(size, "**`minimal`**", 1)?
    );
    text += &format!(
        "\n| the same work in the fastest other navigator, fusion-nav: predict, update, one second | {:.1}, {:.0} and {:.0} times \
         as many | `cargo xtask peers` |",
        times(every_sample, 2)?,
        times(every_sample, 4)?,
        times(usual, 5)?
    );
    Ok(text)
}

/// A cell of the line that begins with this name.
fn cell<'a>(table: &'a str, name: &str, column: usize) -> Result<&'a str> {
    let mut lines = table.lines().map(|line| line.trim_matches('|').trim());
    let line = lines.find(|line| line.split(" | ").next() == Some(name));
    line.and_then(|line| line.split(" | ").nth(column))
        .map(str::trim)
        .with_context(|| format!("`{name}` in BENCHMARKS.md"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_readme_shows_what_was_measured() {
        let read = |page| fs::read_to_string(shell::root().join(page)).unwrap();
        let (readme, benchmarks) = (read("README.md"), read("BENCHMARKS.md"));
        let (_, shown, _) = section(&readme, "bench").unwrap();
        assert!(
            shown == text(&benchmarks).unwrap(),
            "the costs in README.md are not those of BENCHMARKS.md: `cargo xtask bench`"
        );
    }

    #[test]
    fn cells_are_found_by_the_whole_name() {
        let table = "| work | scalar | opt 3 |\n|---|---|---|\n| step, first | f32 | 7 / 8 |\n| step | f32 | 1,234 / 56 |";
        assert_eq!(cell(table, "step", 2).unwrap(), "1,234 / 56");
        assert!(cell(table, "ste", 2).is_err());
        assert!(cell(table, "step", 3).is_err());
    }
}
