//! What was found, as JSON, as a table and as a page with pictures.

use navsight::observability::ceiling::ceiling;
use navsight::observability::comprehensive::combinations;
use navsight::observability::eigen_degree::Eigen;
use navsight::observability::structural::Class;
use serde_json::{json, Map, Value};

use super::{Fixed, Found, N};
use crate::lab::structural;
use crate::report::{graph, short, Page, Table, Tone};

/// Couplings below this, prior-weighted, are left out of `couplings`.
const NO_COUPLING: f64 = 1e-6;

/// A number, or null where it is none.
fn number(x: f64) -> Value {
    if x.is_finite() {
        json!(x)
    } else {
        Value::Null
    }
}

const fn word(class: Class) -> &'static str {
    match class {
        Class::Unique => "unique",
        Class::Coupled => "coupled",
        Class::Unseen => "unseen",
    }
}

impl Found {
    pub(super) fn json(&self, model: &Fixed) -> Value {
        let n = model.n();
        let named = |v: &[f64; N], least: f64| {
            let mut map = Map::new();
            for (name, x) in model.names.iter().zip(v).filter(|(_, x)| x.abs() > least) {
                map.insert(name.clone(), number(*x));
            }
            Value::Object(map)
        };
        let rows: Vec<Value> = combinations(&self.staged)
            .map(|c| {
                let mut couplings = c.coupling;
                couplings[c.pivot] = 0.0;
                json!({
                    "pivot": model.names[c.pivot], "order": c.order, "degree": number(c.degree),
                    "couplings": named(&couplings, NO_COUPLING),
                    "strict": c.kept(NO_COUPLING) == 1 << c.pivot,
                })
            })
            .collect();
        let eigen = |list: &[Eigen<f64, N>]| {
            list.iter()
                .map(|e| {
                    json!({
                        "lambda": number(e.lambda), "naive_order": e.naive_order,
                        "min_order": e.min_order, "combination": named(&e.vector, 1e-6),
                    })
                })
                .collect::<Vec<_>>()
        };
        let mut agreement = Map::new();
        for (view, sentence) in self.views.iter().zip(&self.sentences) {
            agreement.insert(
                model.names[view.state].clone(),
                json!({ "flag": view.flag(&self.limits).name(), "sentence": sentence }),
            );
        }
        json!({
            "states": model.names,
            "rank": self.staged.rank(),
            "rank_total": self.rank_total,
            "rows": rows,
            "eigen": eigen(&self.eigen[0]),
            "eigen_segments": self.eigen.iter().map(|list| eigen(list)).collect::<Vec<_>>(),
            "ceilings": model.names.iter().zip(&self.share).zip(&self.xi2).map(|((name, s), xi2)| {
                (name.clone(), json!({
                    "unseen_share": s, "ceiling": ceiling(*s), "saturation": number(s * xi2),
                }))
            }).collect::<Map<_, _>>(),
            "structural": {
                "is_upper_bound": true,
                "segments": self.reports.iter().map(|r| json!({
                    "reach": r.reach, "nu": r.nu, "d": r.d, "unique": r.unique, "coupled": r.coupled,
                    "unseen": r.unseen, "premise": r.premise, "structurally_observable": r.observable,
                })).collect::<Vec<_>>(),
                "diff_bound": self.bound.bound, "diff_dm_always": self.bound.always,
                "class": model.names.iter().zip(&self.views)
                    .map(|(name, v)| (name.clone(), json!(v.class.map(word)))).collect::<Map<_, _>>(),
            },
            "xi2": self.xi2[..n].iter().map(|x| number(*x)).collect::<Vec<_>>(),
            "agreement": agreement,
            "directions": self.directions.iter().map(|(v, d)| json!({
                "combination": named(v, 1e-6), "eta2": number(d.eta2), "unseen_share": d.share,
                "flag": d.flag.name(),
            })).collect::<Vec<_>>(),
        })
    }

    pub(super) fn table(&self, model: &Fixed) -> Table {
        let caption = format!(
            "rank {} of {} (stripped), {} (total); structural bound {}",
            self.staged.rank(),
            model.n(),
            self.rank_total,
            self.bound.bound
        );
        let mut table = Table::new(
            caption,
            [
                "state",
                "structure",
                "order",
                "degree",
                "strict",
                "ceiling",
                "ξ2",
                "flag",
            ],
        );
        for v in &self.views {
            table.row([
                model.names[v.state].clone(),
                v.class.map_or("", word).into(),
                v.order.map_or("–".into(), |k| k.to_string()),
                v.degree.map_or("–".into(), short),
                if v.strict { "yes" } else { "no" }.into(),
                v.ceiling()
                    .filter(|c| *c < 1e12)
                    .map_or("none".into(), short),
                short(self.xi2[v.state]),
                v.flag(&self.limits).name().into(),
            ]);
        }
        table
    }

    pub(super) fn page(&self, model: &Fixed) -> Page {
        let mut page = Page::new(
            "What can be learnt, and why not",
            "One model, every way of looking at its observability, and where they disagree.",
        );
        for (view, sentence) in self.views.iter().zip(&self.sentences) {
            let tone = match view.flag(&self.limits).name() {
                "agree" => Tone::Good,
                "contradiction" => Tone::Bad,
                _ => Tone::Note,
            };
            page.verdict(tone, &model.names[view.state], &format!("{sentence}."));
        }
        page.section("State by method");
        page.table(&self.table(model));
        page.figures(
            1,
            &[self.heat(model)],
            "Full: seen. Pale: not seen. Saturation is ξ2 over its ceiling.",
        );
        for (k, p) in self.patterns.iter().enumerate() {
            page.section(&format!("Structure of segment {}", k + 1));
            let outputs: Vec<String> = (1..=model.outputs).map(|i| format!("z{i}")).collect();
            page.figures(
                2,
                &structural::pictures(p, &model.names, &outputs),
                "Left: states and what they act on, a maximum matching marked. Right: disjoint paths from the initial \
                 states to the outputs, one column for each derivative.",
            );
        }
        page.section("Directions, most informed first (σ0 units)");
        let bars: Vec<String> = self
            .directions
            .iter()
            .map(|(v, d)| {
                let title = format!("η2 {} ({})", short(d.eta2), d.flag.name());
                graph::bars(&title, &model.names, &v[..model.n()])
            })
            .collect();
        page.figures(
            3,
            &bars,
            "Eigen-directions of the information; η2 is what the filter has left along them.",
        );
        page
    }

    fn heat(&self, model: &Fixed) -> String {
        let cells: Vec<Vec<(f64, String)>> = self
            .views
            .iter()
            .map(|v| {
                let class = match v.class {
                    Some(Class::Unique) => 1.0,
                    Some(Class::Coupled) => 0.5,
                    _ => 0.0,
                };
                let order = v.order.map_or(0.0, |k| 1.0 - f64::from(k) / 5.0);
                let xi2 = self.xi2[v.state];
                let saturation = if v.share > 1e-12 { v.share * xi2 } else { 1.0 };
                vec![
                    (class, v.class.map_or("", word).into()),
                    (order, v.order.map_or("–".into(), |k| format!("order {k}"))),
                    (1.0 - v.share, short(1.0 - v.share)),
                    (xi2.log10() / 6.0, short(xi2)),
                    (saturation, short(saturation)),
                ]
            })
            .collect();
        graph::heat_map(
            &model.names,
            &[
                "structure",
                "Peng order",
                "Yang seen share",
                "ξ2",
                "saturation",
            ],
            &cells,
        )
    }
}
