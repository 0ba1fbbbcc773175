//! `lab montecarlo`: is the filter as good as it says? Errors and innovations over many seeds against their χ² bands.
//!
//! A run can be spread over machines: `--shard i/n` runs every n-th seed and writes a part, `--merge` adds parts up.

use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;

use clap::builder::ValueParser;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::json;

use super::align::compare;
use super::scenario::File;
use super::LabError;
use crate::alignment::tally::GROUPS;
use crate::alignment::{monte_carlo, Cell, Tally, Variant};
use crate::report::{write_file, Cell as Shown, Table, Tone};

/// Flags of the command.
#[derive(clap::Args)]
pub struct Args {
    /// TOML with the scenario, as for `align --scenario`; section 3 of Peng 2016 without it
    #[arg(long, value_name = "FILE")]
    scenario: Option<PathBuf>,
    /// Draw the truth from the prior and tell the filter the real disturbance, whatever the scenario says: then ANEES must be 1
    #[arg(long)]
    consistent: bool,
    /// Seeds in all
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    seeds: Option<u64>,
    /// The first of them
    #[arg(long, value_name = "N")]
    first: Option<u64>,
    /// Run only the i-th of n shares of the seeds, i from 1
    #[arg(long, value_name = "I/N", value_parser = ValueParser::new(shard), requires = "out")]
    shard: Option<(u64, u64)>,
    /// Write the sums as a part that `--merge` can add up
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Add up these parts and run nothing
    #[arg(long, value_name = "FILE", num_args = 1.., conflicts_with_all = ["scenario", "consistent", "seeds", "first", "shard"])]
    merge: Vec<PathBuf>,
    /// One JSON object on standard output instead of tables
    #[arg(long)]
    json: bool,
}

fn shard(text: &str) -> Result<(u64, u64), String> {
    let wrong = || "expected i/n with 1 ≤ i ≤ n, as in 2/8".to_owned();
    let (i, n) = text.split_once('/').ok_or_else(wrong)?;
    let (i, n) = (
        i.parse().map_err(|_| wrong())?,
        n.parse().map_err(|_| wrong())?,
    );
    if (1..=n).contains(&i) {
        Ok((i, n))
    } else {
        Err(wrong())
    }
}

/// A part of a run, on disk.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Part {
    /// What was run: parts of different runs must not be added up.
    run: String,
    /// Its shares, from 1, of how many.
    shares: Vec<u64>,
    of: u64,
    seeds: u64,
    cells: Vec<Entry>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    variant: Variant,
    position: usize,
    second: u32,
    sums: Cell,
}

/// Runs or merges, prints, writes.
pub fn run(args: &Args) -> Result<(), LabError> {
    let (part, tally) = match args.merge.is_empty() {
        true => simulate(args)?,
        false => merge(&args.merge)?,
    };
    if let Some(out) = &args.out {
        let text = serde_json::to_string(&part)
            .map_err(|e| LabError::in_file(out, format!("cannot be written: {e}")))?;
        write_file(out, &text)?;
    }
    if args.json {
        let cells: Vec<_> = tally
            .cells
            .iter()
            .map(|((variant, position, second), cell)| {
                let mut value = compare::cell_json(cell);
                value["variant"] = json!(variant);
                value["position"] = json!(position + 1);
                value["second"] = json!(second);
                value
            })
            .collect();
        return super::print_json(&json!({
            "seeds": tally.seeds,
            "shares": part.shares,
            "of": part.of,
            "cells": cells,
        }));
    }
    super::print_text(&table(&tally).to_text())
}

fn simulate(args: &Args) -> Result<(Part, Tally), LabError> {
    let file = match &args.scenario {
        Some(path) => File::read(path)?,
        None => File::default(),
    };
    let mut scenario = file.scenario();
    if args.consistent {
        scenario = scenario.consistent();
    }
    let seeds = args.seeds.unwrap_or(file.seeds);
    let first = args.first.unwrap_or(file.first_seed);
    let (i, n) = args.shard.unwrap_or((1, 1));
    let mine: Vec<u64> = (first..first.saturating_add(seeds))
        .filter(|seed| (seed - first) % n == i - 1)
        .collect();
    let bar = super::progress(mine.len() as u64, "montecarlo");
    let run = format!(
        "{seeds} seeds from {first}: {:?} {scenario:?}",
        file.variants
    );
    let tally = monte_carlo(&scenario, &file.variants, mine.into_par_iter(), || {
        bar.inc(1)
    })
    .map_err(|e| LabError::plain(format!("the filter refused this scenario: {e:?}")))?;
    bar.finish_and_clear();
    Ok((part(run, vec![i], n, &tally), tally))
}

fn part(run: String, shares: Vec<u64>, of: u64, tally: &Tally) -> Part {
    let cells = tally.cells.iter();
    Part {
        run,
        shares,
        of,
        seeds: tally.seeds,
        cells: cells
            .map(|(&(variant, position, second), sums)| Entry {
                variant,
                position,
                second,
                sums: sums.clone(),
            })
            .collect(),
    }
}

fn merge(paths: &[PathBuf]) -> Result<(Part, Tally), LabError> {
    let mut all: Option<Part> = None;
    let mut tally = Tally::default();
    for path in paths {
        let refused = |what: String| LabError::in_file(path, what);
        let text = fs::read_to_string(path).map_err(|e| refused(format!("cannot be read: {e}")))?;
        let one: Part = serde_json::from_str(&text)
            .map_err(|e| refused(format!("is no part of a run: {e}")).line(e.line()))?;
        if let Some(before) = &mut all {
            if before.run != one.run || before.of != one.of {
                return Err(
                    refused("belongs to another run than the files before".into()).field("run"),
                );
            }
            if let Some(share) = one.shares.iter().find(|s| before.shares.contains(s)) {
                return Err(refused(format!("share {share} is there twice")).field("shares"));
            }
            before.shares.extend(&one.shares);
        }
        let cells: BTreeMap<_, _> = one
            .cells
            .iter()
            .map(|e| ((e.variant, e.position, e.second), e.sums.clone()))
            .collect();
        tally.merge(&Tally {
            seeds: one.seeds,
            cells,
        });
        all.get_or_insert(one);
    }
    let Some(mut all) = all else {
        return Err(LabError::plain("nothing to merge").field("--merge"));
    };
    all.shares.sort_unstable();
    let merged = part(all.run, all.shares, all.of, &tally);
    Ok((merged, tally))
}

fn table(tally: &Tally) -> Table {
    let mut table = Table::new(
        format!(
            "{} seeds: rms and σ of the heading [°]; normalised errors (1 is right, * beyond 95 %, ** beyond 99.9 %) and the part within 3σ",
            tally.seeds
        ),
        [
            "variant", "position", "at [s]", "rms", "own σ", "ANEES", "3σ", "ANEES", "3σ", "ANEES", "3σ", "NIS/row",
        ],
    )
    .groups([("", 3), ("heading", 2), ("heading", 2), ("gyros", 2), ("accelerometers", 2), ("", 1)]);
    for ((variant, position, second), cell) in &tally.cells {
        let mut row: Vec<Shown> = vec![
            variant.name().into(),
            (position + 1).to_string().into(),
            second.to_string().into(),
            format!("{:.4}", cell.heading_rms_deg()).into(),
            format!("{:.4}", cell.heading_sigma_deg()).into(),
        ];
        for g in 0..GROUPS.len() {
            let x = cell.anees(g);
            let beyond = |z| {
                let (low, high) = cell.band(g, z);
                x < low || x > high
            };
            let (mark, tone) = match (beyond(3.29), beyond(1.96)) {
                (true, _) => ("**", Tone::Bad),
                (_, true) => ("*", Tone::Note),
                _ => ("", Tone::Plain),
            };
            row.push(Shown::toned(format!("{x:.2}{mark}"), tone));
            row.push(format!("{:.1} %", 100.0 * cell.coverage(g)[1]).into());
        }
        row.push(format!("{:.3}", cell.nis_per_row()).into());
        table.row(row);
    }
    table
}
