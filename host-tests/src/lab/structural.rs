//! `lab structural`: what zero patterns decide, by graphs.

use std::path::PathBuf;
use std::slice::from_ref;

use navsight::observability::structural::*;
use serde::Deserialize;
use serde_json::{json, Value};

use super::json::Source;
use super::{json, print_json, LabError};
use crate::report::{graph, Page, Table};

/// Room for states.
const N: usize = MAX_STATES;
/// Room for layers: eight segments of span 32.
const LAYERS: usize = N * MAX_SEGMENTS;
/// Matchings are counted up to here.
const COUNT: usize = 1000;

/// Flags of the command.
#[derive(clap::Args)]
pub struct Args {
    /// JSON: a list of cases, or an object with `cases`; kind `lti` with n, m, adj, or `pwcs` with seg_adj, changed_row_masks
    #[arg(long, value_name = "FILE")]
    cases: PathBuf,
    /// Writes report.html with the graphs drawn into this folder
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
    /// One JSON object on standard output instead of a table
    #[arg(long)]
    json: bool,
}

#[derive(Deserialize)]
#[serde(untagged)]
enum Cases {
    Object { cases: Vec<Case> },
    List(Vec<Case>),
}

#[derive(Deserialize)]
struct Case {
    name: String,
    #[serde(default)]
    kind: Option<String>,
    n: usize,
    m: usize,
    adj: Option<Vec<u64>>,
    seg_adj: Option<Vec<Vec<u64>>>,
    changed_row_masks: Option<Vec<Vec<u64>>>,
}

/// A case that makes sense.
enum Checked {
    Lti(Box<Pattern<N>>),
    Pwcs(Vec<Pattern<N>>, Box<Segments<N>>),
}

/// Reads, runs, prints.
pub fn run(args: &Args) -> Result<(), LabError> {
    let (cases, source) = json::read::<Cases>(&args.cases)?;
    let cases = match cases {
        Cases::Object { cases } | Cases::List(cases) => cases,
    };
    if cases.is_empty() {
        return Err(source.wrong("cases", "cases", "there is no case"));
    }
    let mut out = Vec::new();
    let mut page = Page::new(
        "What the structure decides",
        "Zero patterns only: numbers are bounds that almost every choice of the entries reaches.",
    );
    let mut table = Table::new(
        "structural observability (upper bounds for the rank)",
        ["case", "n", "nu", "d or D", "unique", "unseen"],
    );
    for (i, case) in cases.iter().enumerate() {
        let checked = case.check(i, &source)?;
        let values = checked.values(case);
        let word = |key: &str| values[key].as_u64().unwrap_or(0);
        let (bound, unique, unseen) = match checked {
            Checked::Lti(_) => ("d", "unique", "unseen"),
            Checked::Pwcs(..) => ("diff_bound", "diff_dm_always", "unseen"),
        };
        table.row([
            case.name.clone(),
            case.n.to_string(),
            values["nu"]
                .as_u64()
                .map_or_else(|| values["seg_nu"].to_string(), |nu| nu.to_string()),
            word(bound).to_string(),
            numbers(word(unique)),
            numbers(word(unseen)),
        ]);
        if args.report.is_some() {
            checked.draw(case, &mut page);
        }
        out.push(values);
    }
    if let Some(folder) = &args.report {
        page.table(&table);
        eprintln!("{}", page.write(folder)?.display());
    }
    if args.json {
        print_json(&json!({ "cases": out }))
    } else {
        println!("{}", table.to_text());
        Ok(())
    }
}

/// Members of a set, counted from 1 as in print.
fn numbers(set: u64) -> String {
    let list: Vec<String> = members(set as u32).map(|j| (j + 1).to_string()).collect();
    if list.is_empty() {
        "none".into()
    } else {
        list.join(" ")
    }
}

impl Case {
    fn check(&self, i: usize, source: &Source) -> Result<Checked, LabError> {
        let wrong = |key: &str, what: String| {
            let mut error = source.wrong(key, format!("cases[{i}].{key}"), what);
            // The key repeats in every case; the name does not.
            error.line = source
                .wrong(&self.name, "", "")
                .line
                .filter(|line| *line > 1)
                .or(error.line);
            error
        };
        if self.n == 0 || self.n > N {
            return Err(wrong(
                "n",
                format!("{} states; 1 to {N} are possible", self.n),
            ));
        }
        if self.m == 0 || self.m > N {
            return Err(wrong(
                "m",
                format!("{} outputs; 1 to {N} are possible", self.m),
            ));
        }
        let pattern = |key: &str, words: &[u64]| {
            if words.len() != self.n {
                let what = format!("{} words for {} states", words.len(), self.n);
                return Err(wrong(key, what));
            }
            Pattern::from_adjacency(words, self.m)
                .map_err(|_| wrong(key, format!("an edge beyond output {}", self.m)))
        };
        let kind = self.kind.as_deref().unwrap_or(match self.adj {
            Some(_) => "lti",
            None => "pwcs",
        });
        match (kind, &self.adj, &self.seg_adj) {
            ("lti", Some(adj), _) => Ok(Checked::Lti(Box::new(pattern("adj", adj)?))),
            ("lti", None, _) => Err(wrong("adj", "is missing".into())),
            ("pwcs", _, Some(segments)) => {
                if segments.is_empty() || segments.len() > MAX_SEGMENTS {
                    let what = format!(
                        "{} segments; 1 to {MAX_SEGMENTS} are possible",
                        segments.len()
                    );
                    return Err(wrong("seg_adj", what));
                }
                let patterns = segments
                    .iter()
                    .map(|adj| pattern("seg_adj", adj))
                    .collect::<Result<Vec<_>, _>>()?;
                let key = "changed_row_masks";
                let none = Vec::new();
                let masks = self.changed_row_masks.as_ref().unwrap_or(&none);
                if masks.len() + 1 != patterns.len() {
                    let what = format!("{} for {} segments", masks.len(), patterns.len());
                    return Err(wrong(key, what));
                }
                let mut all = Segments::new(&patterns[0]);
                for (p, rows) in patterns[1..].iter().zip(masks) {
                    if rows.len() != self.n || rows.iter().any(|r| r >> self.n != 0) {
                        return Err(wrong(key, format!("has to be {} rows of {0} bits", self.n)));
                    }
                    let mut changes = Changes { rows: [0; N] };
                    for (row, mask) in changes.rows.iter_mut().zip(rows) {
                        *row = *mask as u32;
                    }
                    all.add(p, &changes)
                        .map_err(|_| wrong(key, "does not fit".into()))?;
                }
                Ok(Checked::Pwcs(patterns, Box::new(all)))
            }
            ("pwcs", _, None) => Err(wrong("seg_adj", "is missing".into())),
            (other, ..) => Err(wrong("kind", format!("{other}: lti and pwcs are possible"))),
        }
    }
}

impl Checked {
    fn values(&self, case: &Case) -> Value {
        match self {
            Checked::Lti(p) => {
                let r = Report::new(p);
                let spans = Linking::<N, N>::new(from_ref(p)).by_span();
                json!({
                    "name": case.name, "kind": "lti", "n": case.n, "m": case.m,
                    "reach": r.reach, "nu": r.nu, "d": r.d, "is_upper_bound": true,
                    "linking_by_span": spans[..case.n], "structurally_observable": r.observable,
                    "premise_nu_eq_d": r.premise, "unique": r.unique, "unseen": r.unseen,
                    "groups": Groups::of_linking(&Linking::<N, N>::of_span(from_ref(p), case.n)).sets(),
                    "by_convention": Linking::<N, N>::new(from_ref(p)).by_convention(&[]),
                    "count_max_matchings": Matchings::new(p).count(COUNT, 1_000_000),
                })
            }
            Checked::Pwcs(patterns, segments) => {
                let reports: Vec<Report> = patterns.iter().map(Report::new).collect();
                let mut linking = Linking::<N, LAYERS>::new(patterns);
                linking.widen(case.n);
                linking.link(u32::MAX);
                let b = segments.bound(patterns);
                let all = patterns[0].all();
                json!({
                    "name": case.name, "kind": "pwcs", "n": case.n, "m": case.m,
                    "seg_nu": reports.iter().map(|r| r.nu).collect::<Vec<_>>(),
                    "seg_d": reports.iter().map(|r| r.d).collect::<Vec<_>>(),
                    "premise": reports.iter().map(|r| r.premise).collect::<Vec<_>>(),
                    "premise_reach": b.premise, "union_reach": b.reach,
                    "unseen": all & !b.reach,
                    "def4_linking": linking.size(),
                    "bg_shared": matching_shared(patterns), "bg_separate": matching_separate(patterns),
                    "diff_bound": b.bound, "bound": b.bound, "is_upper_bound": true,
                    "diff_dm_always": b.always, "diff_groups": b.groups.sets(),
                })
            }
        }
    }

    fn draw(&self, case: &Case, page: &mut Page) {
        let pattern = match self {
            Checked::Lti(p) => p.as_ref(),
            Checked::Pwcs(patterns, _) => &patterns[0],
        };
        page.section(&case.name);
        page.figures(
            2,
            &pictures(pattern, &names(case.n, "x"), &names(case.m, "y")),
            "Left: states and what they act on, a maximum matching marked. Right: disjoint paths from the initial states \
             to the outputs, one column for each derivative.",
        );
    }
}

fn names(count: usize, letter: &str) -> Vec<String> {
    (1..=count).map(|i| format!("{letter}{i}")).collect()
}

/// The bipartite graph with a maximum matching, and the linking within the least span that suffices.
pub fn pictures(pattern: &Pattern<N>, states: &[String], outputs: &[String]) -> [String; 2] {
    let n = pattern.states();
    let right: Vec<String> = states.iter().chain(outputs).cloned().collect();
    let mut edges = Vec::new();
    for j in 0..n {
        edges.extend(members(pattern.to(j)).map(|i| (j, i)));
        edges.extend(members(pattern.out(j)).map(|k| (j, n + k)));
    }
    let matching = maximum_matching(pattern);
    let row = |r: usize| if r < 32 { r } else { n + r - 32 };
    let chosen: Vec<(usize, usize)> = matching
        .right
        .iter()
        .take(n)
        .enumerate()
        .filter(|(_, r)| **r != u8::MAX)
        .map(|(j, r)| (j, row(usize::from(*r))))
        .collect();
    let spans = Linking::<N, N>::new(from_ref(pattern)).by_span();
    let most = spans[..n].iter().copied().max().unwrap_or(0);
    let span = spans.iter().position(|s| *s == most).unwrap_or(0) + 1;
    let linking = Linking::<N, N>::of_span(from_ref(pattern), span);
    let paths: Vec<Vec<usize>> = members(linking.states())
        .filter_map(|j| {
            let (_, steps) = linking.path(j)?;
            Some(std::iter::once(j).chain(steps.map(row)).collect())
        })
        .collect();
    [
        graph::bipartite(states, &right, &edges, &chosen),
        graph::linking(states, outputs, span, &paths),
    ]
}
