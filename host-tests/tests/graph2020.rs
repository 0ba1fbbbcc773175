//! Structural observability against the golden cases and the printed claims of the graph paper (2020).
#![cfg(not(target_os = "none"))]

use navsight::observability::structural::*;
use serde_json::Value;

const N: usize = 32;
/// Layers for eight segments of span 15.
const LAYERS: usize = 120;

fn golden() -> Value {
    serde_json::from_str(include_str!("../golden/graph2020.json")).unwrap()
}

fn int(v: &Value) -> u64 {
    v.as_u64().unwrap()
}

fn ints(v: &Value) -> Vec<u64> {
    v.as_array().unwrap().iter().map(int).collect()
}

fn case(name: &str) -> Value {
    let golden = golden();
    let cases = golden["cases"].as_array().unwrap();
    cases.iter().find(|c| c["name"] == name).unwrap().clone()
}

fn pattern(adj: &Value, case: &Value) -> Pattern<N> {
    let words = ints(adj);
    assert_eq!(words.len() as u64, int(&case["n"]));
    Pattern::from_adjacency(&words, int(&case["m"]) as usize).unwrap()
}

fn lti(name: &str) -> (Value, Pattern<N>) {
    let case = case(name);
    let p = pattern(&case["adj"], &case);
    (case, p)
}

fn segments(case: &Value) -> (Vec<Pattern<N>>, Segments<N>) {
    let patterns: Vec<_> = case["seg_adj"]
        .as_array()
        .unwrap()
        .iter()
        .map(|adj| pattern(adj, case))
        .collect();
    let mut segments = Segments::new(&patterns[0]);
    for (p, masks) in patterns[1..]
        .iter()
        .zip(case["changed_row_masks"].as_array().unwrap())
    {
        let mut changes = Changes { rows: [0; N] };
        for (row, mask) in changes.rows.iter_mut().zip(ints(masks)) {
            *row = mask as u32;
        }
        segments.add(p, &changes).unwrap();
    }
    (patterns, segments)
}

/// Sets of a golden list, ordered as ours.
fn sets(v: &Value) -> Vec<u32> {
    let mut sets: Vec<u32> = ints(v).into_iter().map(|s| s as u32).collect();
    sets.sort_by_key(|s| s.trailing_zeros());
    sets
}

#[test]
fn all_golden_cases_equal_exactly() {
    let golden = golden();
    let cases = golden["cases"].as_array().unwrap();
    assert_eq!(cases.len(), 69);
    for c in cases {
        let name = c["name"].as_str().unwrap();
        if c["kind"] == "lti" {
            let p = pattern(&c["adj"], c);
            let n = p.states();
            let r = Report::new(&p);
            assert_eq!(u64::from(r.reach), int(&c["reach"]), "{name} reach");
            assert_eq!(u64::from(r.nu), int(&c["nu"]), "{name} nu");
            assert_eq!(u64::from(r.d), int(&c["d"]), "{name} d");
            assert_eq!(u64::from(r.unique), int(&c["unique"]), "{name} unique");
            assert_eq!(u64::from(r.unseen), int(&c["unseen"]), "{name} unseen");
            assert_eq!(
                Value::from(r.premise),
                c["premise_nu_eq_d"],
                "{name} premise"
            );
            assert_eq!(
                Value::from(r.observable),
                c["structurally_observable"],
                "{name} Lemma 1"
            );
            let spans: Vec<u64> = linking_by_span::<N, N>(&p)[..n]
                .iter()
                .map(|s| u64::from(*s))
                .collect();
            assert_eq!(spans, ints(&c["linking_by_span"]), "{name} linking");
            let groups = Groups::of_pattern::<N>(&p);
            assert_eq!(groups.sets(), sets(&c["groups"]), "{name} groups");
        } else {
            let (patterns, segs) = segments(c);
            let n = patterns[0].states();
            let each: Vec<Report> = patterns.iter().map(Report::new).collect();
            let list =
                |f: fn(&Report) -> u8| each.iter().map(|r| u64::from(f(r))).collect::<Vec<_>>();
            assert_eq!(list(|r| r.nu), ints(&c["seg_nu"]), "{name} seg_nu");
            assert_eq!(list(|r| r.d), ints(&c["seg_d"]), "{name} seg_d");
            let premise: Vec<bool> = each.iter().map(|r| r.premise).collect();
            assert_eq!(Value::from(premise), c["premise"], "{name} premise");
            let mut linking = Linking::<N, LAYERS>::new(&patterns);
            linking.widen(n);
            linking.link(u32::MAX);
            assert_eq!(
                linking.size() as u64,
                int(&c["def4_linking"]),
                "{name} linking"
            );
            assert_eq!(
                matching_shared(&patterns) as u64,
                int(&c["bg_shared"]),
                "{name}"
            );
            assert_eq!(
                matching_separate(&patterns) as u64,
                int(&c["bg_separate"]),
                "{name}"
            );
            let b = segs.bound(&patterns);
            assert_eq!(u64::from(b.reach), int(&c["union_reach"]), "{name} reach");
            assert_eq!(b.bound as u64, int(&c["diff_bound"]), "{name} D");
            assert_eq!(
                u64::from(b.always),
                int(&c["diff_dm_always"]),
                "{name} always"
            );
            assert_eq!(Value::from(b.premise), c["premise_reach"], "{name} premise");
            // The bound is one for both matrices, and the exact rank where the premise holds.
            assert!(
                b.bound as u64 >= int(&c["som_rank"]).max(int(&c["tom_rank"])),
                "{name}"
            );
            if b.premise && !name.ends_with("_tilt_V") {
                assert_eq!(b.bound as u64, int(&c["som_rank"]), "{name} rank");
                assert_eq!(u64::from(b.always), int(&c["som_unique"]), "{name}");
                assert_eq!(b.groups.sets(), sets(&c["som_groups"]), "{name} groups");
            }
        }
    }
}
