//! Structural observability against the golden cases and the printed claims of the graph paper (2020).
#![allow(clippy::needless_range_loop)] // matrices, read as in the equations
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
            let spans: Vec<u64> = Linking::<N, N>::new(&[p]).by_span()[..n]
                .iter()
                .map(|s| u64::from(*s))
                .collect();
            assert_eq!(spans, ints(&c["linking_by_span"]), "{name} linking");
            let groups = Groups::of_linking(&Linking::<N, N>::of_span(&[p], n));
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

// ---- every claim of the paper, confirmed or refuted -------------------------------------------------------------

/// States counted from 1, as in print.
fn set(states: &[u32]) -> u32 {
    states.iter().fold(0, |set, s| set | 1 << (s - 1))
}

/// Whether these initial states are linked all together.
fn linked(p: &Pattern<N>, states: u32) -> bool {
    let segments = [*p];
    let mut linking = Linking::<N, N>::new(&segments);
    linking.widen(p.states());
    linking.link(states).count_ones() == states.count_ones()
}

fn all_matchings(p: &Pattern<N>) -> Vec<Matching<N>> {
    let mut search = Matchings::new(p);
    let mut all = Vec::new();
    loop {
        // Small slices: the search has to go on where it stopped.
        match search.next(3) {
            Found::Matching(m) => all.push(m),
            Found::Pending => {}
            Found::End => return all,
        }
    }
}

/// Families of disjoint paths X⁰ → Y of full size in the dynamic graph, counted by trying all.
fn count_linkings(p: &Pattern<N>, span: usize) -> usize {
    fn go(p: &Pattern<N>, span: usize, source: usize, used: &mut Vec<(usize, usize)>) -> usize {
        if source == p.states() {
            return 1;
        }
        walk(p, span, source, 0, source, used)
    }
    fn walk(
        p: &Pattern<N>,
        span: usize,
        source: usize,
        t: usize,
        j: usize,
        used: &mut Vec<(usize, usize)>,
    ) -> usize {
        if t >= span || used.contains(&(t, j)) {
            return 0;
        }
        used.push((t, j));
        let mut count = 0;
        for k in members(p.out(j)) {
            let y = (t + 1, 100 + k);
            if !used.contains(&y) {
                used.push(y);
                count += go(p, span, source + 1, used);
                used.pop();
            }
        }
        for i in members(p.to(j)) {
            count += walk(p, span, source, t + 1, i, used);
        }
        used.pop();
        count
    }
    go(p, span, 0, &mut Vec::new())
}

#[test]
fn example_1_has_two_maximum_matchings() {
    let (case, p) = lti("example1");
    let all = all_matchings(&p);
    let mut ours: Vec<Vec<u64>> = all
        .iter()
        .map(|m| {
            let node = |r: &u8| u64::from(if *r >= 32 { r - 32 + 3 } else { *r });
            m.right[..3].iter().map(node).collect()
        })
        .collect();
    let mut golden: Vec<Vec<u64>> = case["max_matchings"]
        .as_array()
        .unwrap()
        .iter()
        .map(ints)
        .collect();
    ours.sort();
    golden.sort();
    assert_eq!(ours, golden);
    assert_eq!(Matchings::new(&p).count(100, 10_000), Some(2));
    assert_eq!(
        Matchings::new(&p).count(100, 2),
        None,
        "the budget is a bound"
    );
}

#[test]
fn example_2_has_one_linking_of_size_3() {
    // The text speaks of two output nodes; the linking meets three.
    let (_, p) = lti("example1");
    assert_eq!(Linking::<N, N>::new(&[p]).by_span()[..3], [1, 2, 3]);
    assert_eq!(count_linkings(&p, 3), 1);
}

#[test]
fn static_base_seven_of_ten_and_twenty_matchings() {
    let (case, p) = lti("ins10_static_generic");
    let r = Report::new(&p);
    assert_eq!((r.nu, r.d, r.reach, r.premise), (7, 7, 0x3ff, true));
    let all = all_matchings(&p);
    let mut left: Vec<u32> = all.iter().map(Matching::states).collect();
    left.sort_unstable();
    left.dedup();
    assert_eq!((all.len(), left.len()), (20, 20));
    let mut bases: Vec<u32> = ints(&case["bases"]).iter().map(|b| *b as u32).collect();
    bases.sort_unstable();
    assert_eq!(left, bases, "equal to the true column bases");
    // Which states are observable is a choice of basis, but for the two velocities. The customary one by convention:
    let keep = [0, 1, 2, 3, 4, 9, 8, 7];
    assert_eq!(
        0x3ff & !Linking::<N, N>::new(&[p]).by_convention(&keep),
        set(&[6, 7, 8])
    );
    assert_eq!(r.unique, set(&[1, 2]));
}

#[test]
fn example_3_holds_for_deleted_states_only() {
    let (case, p) = lti("ins10_static_generic");
    for d in case["deleted_states"].as_array().unwrap() {
        let gone = int(&d["mask"]) as u32;
        let induced = matching_size(&p.without(gone)) as u64;
        assert_eq!(induced, int(&d["paper"]), "{gone:b} deleted, both copies");
        // As Theorem 1 reads, by left-matched nodes, all twelve give 7, and are true bases.
        assert!(linked(&p, 0x3ff & !gone), "{gone:b}");
        assert_eq!(int(&d["linking_from_kept"]), 7);
    }
    // The three triples whose deletion keeps 7 are the complete list.
    let mut triples = Vec::new();
    for a in 1..=10 {
        for b in a + 1..=10 {
            for c in b + 1..=10 {
                if matching_size(&p.without(set(&[a, b, c]))) == 7 {
                    triples.push([a, b, c]);
                }
            }
        }
    }
    assert_eq!(triples, [[6, 7, 8], [6, 8, 9], [6, 8, 10]]);
}

/// A printed matching: pairs (state, what it acts on), outputs from 101 on. Edges exist, and no node is used twice.
fn is_matching(p: &Pattern<N>, pairs: &[(u32, u32)]) -> bool {
    let edges = pairs.iter().all(|(j, r)| {
        let j = *j as usize - 1;
        match r {
            101.. => p.out(j) >> (r - 101) & 1 == 1,
            i => p.to(j) >> (i - 1) & 1 == 1,
        }
    });
    let distinct = |f: fn(&(u32, u32)) -> u32| {
        let mut nodes: Vec<u32> = pairs.iter().map(f).collect();
        nodes.sort_unstable();
        nodes.windows(2).all(|w| w[0] != w[1])
    };
    edges && distinct(|p| p.0) && distinct(|p| p.1)
}

const Y1: u32 = 101;
const Y2: u32 = 102;

#[test]
fn printed_matchings_are_matchings_but_one_is_listed_under_the_wrong_states() {
    let (_, p) = lti("ins10_static_generic");
    let printed: [&[(u32, u32)]; 12] = [
        &[(9, 4), (4, 1), (1, Y1), (10, 5), (5, 3), (3, 2), (2, Y2)],
        &[(7, 2), (2, Y2), (10, 5), (5, 3), (3, 4), (4, 1), (1, Y1)],
        &[(9, 4), (4, 1), (1, Y1), (5, 3), (3, 5), (7, 2), (2, Y2)],
        &[(9, 4), (4, 1), (1, Y1), (8, 3), (3, 2), (2, Y2)],
        &[(8, 3), (3, 4), (4, 1), (1, Y1), (7, 2), (2, Y2)],
        &[(6, 1), (1, Y1), (10, 5), (5, 3), (3, 2), (2, Y2)],
        &[(6, 1), (1, Y1), (3, 5), (5, 3), (7, 2), (2, Y2)],
        &[(6, 1), (1, Y1), (8, 3), (3, 2), (2, Y2)],
        &[(9, 4), (4, 1), (1, Y1), (8, 3), (3, 2), (2, Y2)],
        &[(8, 3), (3, 4), (4, 1), (1, Y1), (7, 2), (2, Y2)],
        &[(6, 1), (1, Y1), (9, 4), (4, 3), (3, 2), (2, Y2)],
        &[(5, 3), (3, 5), (9, 4), (6, 1), (1, Y1), (7, 2), (2, Y2)],
    ];
    for pairs in printed {
        assert!(is_matching(&p, pairs), "{pairs:?}");
    }
    // The last one stands under {6, 8, 10} deleted, and uses 6; its own unmatched states are {4, 8, 10}, which the paper
    // lists with 6 three lines later. 9 → 4 ends there: 4 is not matched, so that stem reaches no output.
    let left = printed[11].iter().fold(0, |s, pair| s | set(&[pair.0]));
    assert_eq!(0x3ff & !left, set(&[4, 8, 10]));
    assert!(left & set(&[6]) != 0);
}

#[test]
fn at_the_pole_nu_is_seven_and_the_dimension_six() {
    // Printed: "for φ = π/2 the maximum matching is 6". The edge 10 → 5 survives and is matched; but 5 and 10 reach no
    // output, so six states can be seen.
    let (case, p) = lti("ins10_static_pole");
    let r = Report::new(&p);
    assert_eq!((r.nu, r.d), (7, 6));
    assert_eq!(r.unseen, set(&[5, 10]));
    assert!(
        !r.premise,
        "fails literally, and holds on what is reachable:"
    );
    assert!(Report::new(&p.without(r.unseen)).premise);
    let bases: Vec<u32> = ints(&case["bases"]).iter().map(|b| *b as u32).collect();
    assert_eq!(bases.len(), 9);
    for b in [set(&[1, 2, 3, 4, 8, 9]), set(&[1, 2, 3, 4, 6, 9])] {
        assert!(
            bases.contains(&b) && linked(&p, b),
            "both printed sets are bases"
        );
    }
    // "Always matched" in BG claims epsU, which nothing sees: not a test for single states.
    assert!(int(&case["dm_always_matched"]) as u32 & set(&[10]) != 0 && r.unique & set(&[10]) == 0);
}

#[test]
fn at_the_equator_the_north_gyro_is_seen_alone() {
    let (case, p) = lti("ins10_static_equator");
    let r = Report::new(&p);
    assert_eq!((r.nu, r.d), (7, 7));
    assert_eq!(ints(&case["bases"]).len(), 12);
    assert_eq!(r.unique, set(&[1, 2, 9]));
    assert!(matching_size(&p.without(set(&[6, 8, 9]))) < 7);
}

#[test]
fn theorem_1_gives_an_upper_bound_and_no_more() {
    // All states reachable, ν = 4, but three branches share what sees them: rank 3.
    let (_, p) = lti("branch_dilation");
    let r = Report::new(&p);
    assert_eq!((r.reach, r.nu, r.d), (p.all(), 4, 3));
    let (_, p) = lti("unreachable_selfloop");
    let r = Report::new(&p);
    assert_eq!((r.nu, r.d), (2, 1));
}

#[test]
fn theorem_2_prints_nine_and_its_own_definition_gives_ten_for_anything() {
    for name in [
        "ins10_segs1to2",
        "ins10_segs1to3",
        "ins10_segs1to4",
        "ins10_segs1to5",
        "ins10_identical_twice",
    ] {
        let c = case(name);
        let (patterns, segs) = segments(&c);
        let mut linking = Linking::<N, LAYERS>::new(&patterns);
        linking.widen(10);
        linking.link(u32::MAX);
        assert_eq!(linking.size(), 10, "{name}: the paper's number is 9");
        assert_eq!(
            matching_shared(&patterns),
            7,
            "{name}: the form behind the paper's 7"
        );
        // What the segments can really show, and the exact rank of the paper's own matrices:
        assert_eq!(
            segs.bound(&patterns).bound as u64,
            int(&c["som_rank"]),
            "{name}"
        );
    }
    // "Never fully observable": refuted by the paper's five segments.
    assert_eq!(int(&case("ins10_segs1to5")["som_rank"]), 10);
}

#[test]
fn example_4_seven_in_every_phase_is_right_for_single_phases() {
    for name in [
        "ins10_static_generic",
        "ins10_segment2",
        "ins10_segment3",
        "ins10_segment4",
    ] {
        let (case, p) = lti(name);
        let r = Report::new(&p);
        assert_eq!((r.nu, r.d), (7, 7), "{name}");
        assert_eq!(int(&case["numeric_rank"]), 7);
    }
    // The "new" matchings: of segment 2, states {6, 7, 8} left over, no new set; of segment 3, {6, 7, 9}, a new one.
    let (_, still) = lti("ins10_static_generic");
    let old: Vec<u32> = all_matchings(&still)
        .iter()
        .map(|m| 0x3ff & !m.states())
        .collect();
    let (_, north) = lti("ins10_segment2");
    let (_, east) = lti("ins10_segment3");
    let second = [(10, 5), (5, 1), (1, Y1), (9, 4), (4, 3), (3, 2), (2, Y2)];
    let third = [(10, 5), (5, 2), (2, Y2), (8, 3), (3, 4), (4, 1), (1, Y1)];
    assert!(is_matching(&north, &second) && old.contains(&set(&[6, 7, 8])));
    assert!(is_matching(&east, &third) && !old.contains(&set(&[6, 7, 9])));
}

#[test]
fn markov_self_loops_make_the_report_worthless() {
    let (case, p) = lti("ins10_static_gauss_markov_equal_tau");
    assert_eq!((Report::new(&p).d, int(&case["numeric_rank"])), (10, 7));
    let cleared = p.without_self_loops(set(&[6, 7, 8, 9, 10]));
    assert_eq!(Report::new(&cleared).d, 7);
    assert_eq!(cleared, lti("ins10_static_generic").1);
}

// ---- numbers against graphs --------------------------------------------------------------------------------------

use host_tests::reference::structural as twin;
use nalgebra::{SMatrix, SVector};
use navsight::observability::comprehensive::combinations;
use navsight::observability::pwcs::{Kind, Scale, Staged};

/// Rank and individually observable states of segments of the 10-state model, by numbers.
fn numeric(matrices: &[SMatrix<f64, 10, 10>], c: &SMatrix<f64, 2, 10>) -> (usize, u32) {
    let kinds = [
        Kind::Velocity,
        Kind::Velocity,
        Kind::Attitude,
        Kind::Attitude,
        Kind::Attitude,
        Kind::AccelBias,
        Kind::AccelBias,
        Kind::GyroBias,
        Kind::GyroBias,
        Kind::GyroBias,
    ];
    // 0.1 m/s, 3 mrad, 20 mrad, 1e-4 g, 0.01 °/h
    let sigma = SVector::from([
        0.1, 0.1, 3e-3, 3e-3, 2e-2, 1e-3, 1e-3, 4.8e-8, 4.8e-8, 4.8e-8,
    ]);
    let mut scale = Scale::canonical(&kinds, &sigma, 9.80665);
    // The seventh singular value of a window is 4e-4 of the first: far above f64's rounding.
    scale.tolerance = 1e-9;
    let mut staged = Staged::<f64, 10, 2>::new(&scale).unwrap();
    for f in matrices {
        staged.segment(f, c, None).unwrap();
    }
    let alone = combinations(&staged)
        .filter(|r| r.kept(1e-7) == 1 << r.pivot)
        .fold(0, |set, r| set | 1 << r.pivot);
    (staged.rank(), alone)
}

fn matrix<const R: usize>(v: &Value) -> SMatrix<f64, R, 10> {
    SMatrix::from_fn(|i, j| v[i][j].as_f64().unwrap())
}

#[test]
fn the_bound_is_the_rank_on_every_subset_of_the_papers_segments() {
    // At rest, north, east, both, up: the fifth has the zero pattern of the first, and only the numbers changed.
    let mut all: Vec<SMatrix<f64, 10, 10>> = [
        "ins10_static_generic",
        "ins10_segment2",
        "ins10_segment3",
        "ins10_segment4",
    ]
    .iter()
    .map(|name| matrix(&case(name)["A"]))
    .collect();
    let mut up = all[0];
    for (i, j) in [(0, 3), (1, 2)] {
        up[(i, j)] += up[(i, j)].signum();
    }
    all.push(up);
    let h = matrix::<2>(&case("ins10_static_generic")["C"]);
    let one = SVector::<f64, 10>::repeat(1.0);
    for subset in 1u32..1 << all.len() {
        let chosen: Vec<_> = members(subset).map(|k| all[k]).collect();
        let patterns: Vec<Pattern<10>> = chosen
            .iter()
            .map(|f| Pattern::from_model(f, &h, &one, 0.0, 0).unwrap())
            .collect();
        let mut segs = Segments::new(&patterns[0]);
        for (p, f) in patterns.iter().zip(&chosen).skip(1) {
            let changes = Changes::between(f, &chosen[0], 1e-12).unwrap();
            segs.add(p, &changes).unwrap();
        }
        let b = segs.bound(&patterns);
        assert_eq!((b.bound, b.always), numeric(&chosen, &h), "{subset:05b}");
    }
}

#[test]
fn the_stripped_matrix_can_miss_what_the_total_one_sees() {
    // x2 moves x3 in the odd segments, where nobody looks; in the even ones x3 moves x1, which is measured. x3 is then
    // x3 + T x2 and x3 + 2T x2 of the start: the premise fails, and only the total matrix sees x2.
    let odd = vec![vec![0.0; 3], vec![0.0; 3], vec![0.0, 1.0, 0.0]];
    let even = vec![vec![0.0, 0.0, 1.0], vec![0.0; 3], vec![0.0; 3]];
    let c = vec![vec![1.0, 0.0, 0.0]];
    let ranks = twin::piecewise_ranks(&[odd.clone(), even.clone(), odd, even], &c, 0.5);
    assert_eq!(ranks, (2, 3));
    let p = Pattern::<3>::from_adjacency(&[0b1000, 0b100, 0], 1).unwrap();
    let q = Pattern::<3>::from_adjacency(&[0b1000, 0, 0b001], 1).unwrap();
    let mut segs = Segments::new(&p);
    let (changed, same) = (
        Changes {
            rows: [0b100, 0, 0b010],
        },
        Changes { rows: [0; 3] },
    );
    segs.add(&q, &changed).unwrap();
    segs.add(&p, &same).unwrap();
    segs.add(&q, &changed).unwrap();
    let patterns = [p, q, p, q];
    let b = segs.bound(&patterns);
    assert_eq!((b.bound, b.premise), (3, false));
    // Definition 4 bounds the stripped matrix only.
    let mut linking = Linking::<3, 12>::new(&patterns);
    linking.widen(3);
    assert_eq!(linking.link(u32::MAX).count_ones(), 2);
}

#[test]
fn ten_thousand_random_patterns_against_numeric_ranks() {
    let mut dice = twin::Dice::new(20_20);
    let (mut nu_above_rank, mut full) = (0, 0);
    for case in 0..10_000 {
        let n = 1 + dice.below(8) as usize;
        let m = 1 + dice.below(3) as usize;
        let adj = twin::random_pattern(&mut dice, n, m);
        let p = Pattern::<8>::from_adjacency(&adj, m).unwrap();
        let r = Report::new(&p);
        // The generic rank is the largest one; a draw can be unlucky, three are not.
        let space = (0..3)
            .map(|_| {
                let (a, c) = twin::instance(&adj, m, &mut dice);
                twin::observable_space(&a, &c)
            })
            .max_by_key(Vec::len)
            .unwrap();
        let rank = space.len();
        assert_eq!(usize::from(r.d), rank, "{case} d of {adj:?}");
        assert_eq!(r.observable, rank == n, "{case} Lemma 1 of {adj:?}");
        assert_eq!(r.unique, twin::alone(&space, n), "{case} unique of {adj:?}");
        assert_eq!(
            usize::from(Linking::<8, 8>::new(&[p]).by_span()[n - 1]),
            rank,
            "{case} linking"
        );
        // Exchange groups say the same about single states as the augmented output.
        let groups = Groups::of_linking(&Linking::<8, 8>::of_span(&[p], n));
        let grouped = groups.sets().iter().fold(0, |all, g| all | g);
        assert_eq!(r.coupled, grouped, "{case} groups of {adj:?}");
        assert!(usize::from(r.nu) >= rank);
        nu_above_rank += u32::from(usize::from(r.nu) > rank);
        full += u32::from(r.observable);
    }
    // The draw has both kinds: Theorem 1 would fail often, and Lemma 1 is not empty.
    assert!(nu_above_rank > 1000 && full > 500, "{nu_above_rank} {full}");
}

#[test]
fn the_bound_is_never_below_the_rank_of_stripped_or_total_matrix() {
    let mut dice = twin::Dice::new(42);
    let mut above = 0;
    for case in 0..3_000 {
        let n = 2 + dice.below(5) as usize;
        let m = 1 + dice.below(2) as usize;
        let adj = twin::random_pattern(&mut dice, n, m);
        let (a, c) = twin::instance(&adj, m, &mut dice);
        let mut matrices = vec![a.clone()];
        let first = Pattern::<8>::from_adjacency(&adj, m).unwrap();
        let mut patterns = vec![first];
        let mut segs = Segments::new(&first);
        for _ in 0..1 + dice.below(2) {
            // Some entries change their value, some appear, the others are repeated.
            let mut b = a.clone();
            let mut words = adj.clone();
            let mut changes = Changes { rows: [0; 8] };
            for i in 0..n {
                for j in 0..n {
                    let there = words[j] >> i & 1 == 1;
                    if dice.below(if there { 4 } else { 12 }) == 0 {
                        b[i][j] = dice.entry();
                        words[j] |= 1 << i;
                        changes.rows[i] |= 1 << j;
                    }
                }
            }
            let p = Pattern::from_adjacency(&words, m).unwrap();
            segs.add(&p, &changes).unwrap();
            patterns.push(p);
            matrices.push(b);
        }
        let (stripped, total) = twin::piecewise_ranks(&matrices, &c, 0.3);
        let b = segs.bound(&patterns);
        assert!(
            b.bound >= stripped.max(total),
            "{case}: {} {stripped} {total}",
            b.bound
        );
        if b.premise {
            assert_eq!(b.bound, stripped, "{case}: exact where the premise holds");
            assert_eq!(total, stripped, "{case}: then both matrices see the same");
        }
        above += u32::from(b.bound > stripped);
    }
    // It is a bound, and not always the rank.
    assert!(above > 0);
}

#[test]
fn renumbering_changes_nothing_but_numbers() {
    let mut dice = twin::Dice::new(3);
    for _ in 0..1_000 {
        let (n, m) = (2 + dice.below(7) as usize, 1 + dice.below(3) as usize);
        let adj = twin::random_pattern(&mut dice, n, m);
        let mut order: Vec<usize> = (0..n).collect();
        for i in (1..n).rev() {
            order.swap(i, dice.below(i as u64 + 1) as usize);
        }
        let moved = |set: u64| members(set as u32).fold(0u64, |out, j| out | 1 << order[j]);
        let mut words = vec![0; n];
        for (j, word) in adj.iter().enumerate() {
            words[order[j]] = moved(word & ((1 << n) - 1)) | word >> n << n;
        }
        let (p, q) = (
            Pattern::<8>::from_adjacency(&adj, m).unwrap(),
            Pattern::<8>::from_adjacency(&words, m).unwrap(),
        );
        let (a, b) = (Report::new(&p), Report::new(&q));
        assert_eq!(
            (a.nu, a.d, a.premise, a.observable),
            (b.nu, b.d, b.premise, b.observable)
        );
        for (a, b) in [
            (a.reach, b.reach),
            (a.unique, b.unique),
            (a.unseen, b.unseen),
        ] {
            assert_eq!(moved(u64::from(a)), u64::from(b));
        }
        assert_eq!(
            Linking::<8, 8>::new(&[p]).by_span(),
            Linking::<8, 8>::new(&[q]).by_span()
        );
        let mut groups: Vec<u64> = Groups::of_linking(&Linking::<8, 8>::of_span(&[p], n))
            .sets()
            .iter()
            .map(|g| moved(u64::from(*g)))
            .collect();
        groups.sort_by_key(|g| g.trailing_zeros());
        let others: Vec<u64> = Groups::of_linking(&Linking::<8, 8>::of_span(&[q], n))
            .sets()
            .iter()
            .map(|g| u64::from(*g))
            .collect();
        assert_eq!(groups, others);
    }
}

#[test]
fn broken_patterns_are_refused() {
    use navsight::error::Error;
    for (states, outputs) in [(0, 1), (33, 1), (1, 0), (1, 33)] {
        assert_eq!(Pattern::<N>::new(states, outputs), Err(Error::Size));
    }
    assert_eq!(Pattern::<8>::new(9, 1), Err(Error::Size));
    assert_eq!(Pattern::<N>::from_adjacency(&[0; 33], 1), Err(Error::Size));
    assert_eq!(
        Pattern::<N>::from_adjacency(&[1 << 2, 0], 1).map(|p| p.out(0)),
        Ok(1)
    );
    assert_eq!(
        Pattern::<N>::from_adjacency(&[1 << 3, 0], 1),
        Err(Error::OutOfRange)
    );
    let (f, h) = (SMatrix::<f64, 2, 2>::zeros(), SMatrix::<f64, 1, 2>::zeros());
    let one = SVector::<f64, 2>::repeat(1.0);
    let mut bad = f;
    bad[(0, 1)] = f64::NAN;
    assert_eq!(
        Pattern::from_model(&bad, &h, &one, 0.0, 0),
        Err(Error::NonFinite)
    );
    assert_eq!(
        Pattern::from_model(&f, &h, &(one * 0.0), 0.0, 0),
        Err(Error::OutOfRange)
    );
    assert_eq!(
        Pattern::from_model(&f, &h, &one, -1.0, 0),
        Err(Error::OutOfRange)
    );
    assert_eq!(
        Pattern::from_model(&f, &h, &one, f64::NAN, 0),
        Err(Error::OutOfRange)
    );
    // A ninth segment, and one of another size.
    let p = Pattern::<8>::new(3, 1).unwrap();
    let none = Changes { rows: [0; 8] };
    let mut segs = Segments::new(&p);
    for _ in 1..MAX_SEGMENTS {
        segs.add(&p, &none).unwrap();
    }
    assert_eq!(segs.add(&p, &none), Err(Error::Size));
    let mut segs = Segments::new(&p);
    assert_eq!(
        segs.add(&Pattern::new(4, 1).unwrap(), &none),
        Err(Error::Size)
    );
    assert_eq!(segs.count(), 1);
}
