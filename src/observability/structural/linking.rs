//! Linking in the dynamic graph: how many initial states reach outputs by disjoint paths within a span.

use super::bits::{at, bit, put, Bits};
use super::Pattern;

/// Most segments of a piecewise constant system.
pub const MAX_SEGMENTS: usize = 8;

/// No node.
const NONE: u8 = 255;
/// Entered from the source of its state.
const SOURCE: u8 = 254;
/// Entered backwards from its own exit: the path through it is taken away.
const BACK: u8 = 253;
/// Left through its own entrance.
const OWN: u8 = 252;
/// Left backwards from the entrance of its successor: that step is taken away.
const UNDO: u8 = 251;
/// Outputs follow 32 states among successors.
const OUTPUT: usize = 32;

/// Vertex-disjoint paths from the initial states to the outputs of a dynamic graph, grown path by path.
///
/// Layers X⁰ … Xˢ⁻¹ and outputs Y¹ … Yˢ; x_j at t acts on x_i at t + 1 and is seen at t + 1 (Definition 3). With several
/// segments (Definition 4) every segment has layers of its own and a path may start in any of them. `L` is the number
/// of layers of all segments together: span n for one segment of n states is `Linking<N, N>`.
///
/// With one segment and span n the size equals d ([`super::Cover`]). With several it is the generic rank of the stripped
/// observability matrix *only if each segment has its own independent parameters*: gravity and earth rate repeat, so it
/// over-estimates (10 for two identical segments of rank 7) and is kept as the paper's number; see [`super::Segments`].
///
/// Memory: 2 N L bytes and 4 L for the paths, the same and 16 L during a search.
#[derive(Clone, Copy, Debug)]
pub struct Linking<'a, const N: usize, const L: usize> {
    segments: &'a [Pattern<N>],
    next: [[u8; N]; L],
    prev: [[u8; N]; L],
    seen: [u32; L],
    source: [u8; N],
    span: usize,
    stride: usize,
    linked: u32,
}

/// What one search left behind.
struct Search<const N: usize, const L: usize> {
    /// By whom an entrance was entered; nothing where it was not.
    entry: [[u8; N]; L],
    /// By whom an exit was left, likewise.
    exit: [[u8; N]; L],
    entered: [u32; L],
    left: [u32; L],
    to_enter: [u32; L],
    to_leave: [u32; L],
}

/// Where a rebuilt path stands.
enum At {
    /// This exit has a new successor.
    Exit(usize, usize, u8),
    /// This entrance needs a new predecessor.
    Entry(usize, usize),
}

fn cell<const N: usize, const L: usize>(table: &[[u8; N]; L], layer: usize, state: usize) -> u8 {
    table
        .get(layer)
        .and_then(|row| row.get(state))
        .copied()
        .unwrap_or(NONE)
}

fn set<const N: usize, const L: usize>(
    table: &mut [[u8; N]; L],
    layer: usize,
    state: usize,
    value: u8,
) {
    if let Some(row) = table.get_mut(layer) {
        put(row, state, value);
    }
}

impl<const N: usize, const L: usize> Search<N, L> {
    fn new() -> Self {
        Self {
            entry: [[0; N]; L],
            exit: [[0; N]; L],
            entered: [0; L],
            left: [0; L],
            to_enter: [0; L],
            to_leave: [0; L],
        }
    }

    fn enter(&mut self, layer: usize, state: usize, by: u8) {
        if at(&self.entered, layer, u32::MAX) & bit(state) == 0 {
            set(&mut self.entry, layer, state, by);
            if let (Some(done), Some(todo)) =
                (self.entered.get_mut(layer), self.to_enter.get_mut(layer))
            {
                *done |= bit(state);
                *todo |= bit(state);
            }
        }
    }

    fn leave(&mut self, layer: usize, state: usize, by: u8) {
        if at(&self.left, layer, u32::MAX) & bit(state) == 0 {
            set(&mut self.exit, layer, state, by);
            if let (Some(done), Some(todo)) =
                (self.left.get_mut(layer), self.to_leave.get_mut(layer))
            {
                *done |= bit(state);
                *todo |= bit(state);
            }
        }
    }

    /// Nothing is to be done in this layer: most of the time in most of them.
    fn rests(&self, layer: usize) -> bool {
        at(&self.to_enter, layer, 0) | at(&self.to_leave, layer, 0) == 0
    }

    /// One member of a worklist, or none.
    fn pop(list: &mut [u32; L], layer: usize) -> Option<usize> {
        let word = list.get_mut(layer)?;
        if *word == 0 {
            return None;
        }
        let state = word.trailing_zeros() as usize;
        *word &= *word - 1;
        Some(state)
    }
}

impl<'a, const N: usize, const L: usize> Linking<'a, N, L> {
    /// No paths, span 0. At most 8 segments are used, and the layers are shared evenly among them.
    pub fn new(segments: &'a [Pattern<N>]) -> Self {
        let segments = segments.get(..MAX_SEGMENTS).unwrap_or(segments);
        Self {
            segments,
            next: [[NONE; N]; L],
            prev: [[NONE; N]; L],
            seen: [0; L],
            source: [NONE; N],
            span: 0,
            stride: L.checked_div(segments.len()).unwrap_or(0),
            linked: 0,
        }
    }

    /// Paths of all states within `span` steps, or as many steps as there are layers.
    pub fn of_span(segments: &'a [Pattern<N>], span: usize) -> Self {
        let mut linking = Self::new(segments);
        linking.widen(span);
        linking.link(u32::MAX);
        linking
    }

    /// Lets paths take up to `span` steps; what is linked stays linked. Returns the span in force.
    pub fn widen(&mut self, span: usize) -> usize {
        self.span = self.span.max(span.min(self.stride));
        self.span
    }

    /// Tries to link each of these states, smallest first; returns those that are linked now. The order decides which
    /// states of a coupled group are taken, never how many.
    pub fn link(&mut self, states: u32) -> u32 {
        for state in Bits(states & self.outside()) {
            self.link_one(state);
        }
        self.linked
    }

    /// Links all states, one more step of the span at a time: how many are linked within the spans 1 … n, so what can be
    /// reached with so many derivatives.
    pub fn by_span(&mut self) -> [u8; N] {
        let states = self.segments.first().map_or(0, Pattern::states);
        let mut sizes = [0; N];
        for (span, size) in (1..=states).zip(&mut sizes) {
            self.widen(span);
            self.link(u32::MAX);
            *size = self.size() as u8;
        }
        sizes
    }

    /// Keeps states in order of preference as long as they stay jointly observable: one customary answer to "which
    /// states are observable", a convention where states are coupled.
    ///
    /// * `keep_first`: states, most wanted first; the others follow by number
    ///
    /// Returns the states that are linked now, within n steps.
    pub fn by_convention(&mut self, keep_first: &[usize]) -> u32 {
        self.widen(self.segments.first().map_or(0, Pattern::states));
        for state in keep_first {
            self.link(bit(*state));
        }
        self.link(u32::MAX)
    }

    /// Number of disjoint paths.
    pub const fn size(&self) -> usize {
        self.linked.count_ones() as usize
    }

    /// States that are linked.
    pub const fn states(&self) -> u32 {
        self.linked
    }

    /// States that are not linked.
    pub(super) fn outside(&self) -> u32 {
        self.segments.first().map_or(0, Pattern::all) & !self.linked
    }

    /// Tries to link one more state, re-routing the paths there are; true where it worked.
    #[inline(never)] // so that the tables of its search are not on the stack of another
    pub fn link_one(&mut self, state: usize) -> bool {
        if self.linked & bit(state) != 0 {
            return true;
        }
        let mut search = Search::new();
        let end = self.search(&mut search, state).0;
        match end {
            Some((layer, last, output)) => {
                self.rebuild(&search, layer, last, output);
                self.linked |= bit(state);
                true
            }
            None => false,
        }
    }

    /// For a state that cannot be linked any more: the linked states that could be given up for it, and itself. Nothing
    /// but itself means that it reaches no output.
    #[inline(never)] // as above
    pub fn circuit(&self, state: usize) -> u32 {
        self.search(&mut Search::new(), state).1
    }

    /// The path of a linked state: its segment, then per step the successor (32 and more: an output).
    pub fn path(&self, state: usize) -> Option<(usize, impl Iterator<Item = usize> + '_)> {
        let segment = usize::from(at(&self.source, state, NONE));
        if segment >= self.segments.len() {
            return None;
        }
        let mut here = Some(state);
        let steps = (0..self.span).map_while(move |t| {
            let next = usize::from(cell(&self.next, segment * self.stride + t, here?));
            here = (next < OUTPUT).then_some(next);
            (next != usize::from(NONE)).then_some(next)
        });
        Some((segment, steps))
    }

    /// Searches a free output from one more state; also which sources could be given up on the way.
    fn search(
        &self,
        search: &mut Search<N, L>,
        state: usize,
    ) -> (Option<(usize, usize, usize)>, u32) {
        let mut sources = bit(state);
        for segment in 0..self.segments.len() {
            search.enter(segment * self.stride, state, SOURCE);
        }
        loop {
            let mut idle = true;
            for (segment, pattern) in self.segments.iter().enumerate() {
                for t in 0..self.span {
                    let layer = segment * self.stride + t;
                    if search.rests(layer) {
                        continue;
                    }
                    while let Some(j) = Search::<N, L>::pop(&mut search.to_enter, layer) {
                        idle = false;
                        match cell(&self.prev, layer, j) {
                            NONE => search.leave(layer, j, OWN),
                            SOURCE => {
                                if sources & bit(j) == 0 {
                                    sources |= bit(j);
                                    for other in 0..self.segments.len() {
                                        if other != segment {
                                            search.enter(other * self.stride, j, SOURCE);
                                        }
                                    }
                                }
                            }
                            before => {
                                search.leave(layer.saturating_sub(1), usize::from(before), UNDO);
                            }
                        }
                    }
                    while let Some(j) = Search::<N, L>::pop(&mut search.to_leave, layer) {
                        idle = false;
                        let taken = at(&self.seen, layer, u32::MAX);
                        let outputs = pattern.out(j);
                        let free = outputs & !taken;
                        if free != 0 {
                            let output = free.trailing_zeros() as usize;
                            return (Some((layer, j, output)), sources);
                        }
                        for k in Bits(outputs & taken) {
                            if let Some(holder) = self.holder(layer, k) {
                                if holder != j {
                                    search.leave(layer, holder, j as u8);
                                }
                            }
                        }
                        if t + 1 < self.span {
                            let next = cell(&self.next, layer, j);
                            let fresh = pattern.to(j) & !at(&search.entered, layer + 1, u32::MAX);
                            for i in Bits(fresh) {
                                if usize::from(next) != i {
                                    search.enter(layer + 1, i, j as u8);
                                }
                            }
                        }
                        if cell(&self.prev, layer, j) != NONE {
                            search.enter(layer, j, BACK);
                        }
                    }
                }
            }
            if idle {
                return (None, sources);
            }
        }
    }

    /// The state whose path ends in output `k` after this layer.
    fn holder(&self, layer: usize, k: usize) -> Option<usize> {
        self.next
            .get(layer)?
            .iter()
            .position(|next| usize::from(*next) == OUTPUT + k)
    }

    /// Walks the search back from the output to the source and moves the paths.
    ///
    /// `exit` at a state that was left through an output held by another (a number below 32) is written under the one
    /// that is pushed away: its path goes on elsewhere, and the output goes to that number.
    fn rebuild(&mut self, search: &Search<N, L>, layer: usize, last: usize, output: usize) {
        if let Some(seen) = self.seen.get_mut(layer) {
            *seen |= bit(output);
        }
        let mut here = At::Exit(layer, last, (OUTPUT + output) as u8);
        // Every entrance and every exit is passed at most once.
        for _ in 0..2 * N * L + 2 {
            here = match here {
                At::Exit(l, j, successor) => {
                    let old = cell(&self.next, l, j);
                    set(&mut self.next, l, j, successor);
                    match cell(&search.exit, l, j) {
                        OWN => At::Entry(l, j),
                        UNDO => At::Entry(l + 1, usize::from(old)),
                        other => At::Exit(l, usize::from(other), old),
                    }
                }
                At::Entry(l, j) => match cell(&search.entry, l, j) {
                    SOURCE => {
                        set(&mut self.prev, l, j, SOURCE);
                        let old = at(&self.source, j, NONE);
                        let segment = l.checked_div(self.stride).unwrap_or(0);
                        put(&mut self.source, j, segment as u8);
                        if old == NONE {
                            return;
                        }
                        At::Entry(usize::from(old) * self.stride, j)
                    }
                    BACK => {
                        let old = cell(&self.next, l, j);
                        set(&mut self.prev, l, j, NONE);
                        set(&mut self.next, l, j, NONE);
                        match cell(&search.exit, l, j) {
                            UNDO => At::Entry(l + 1, usize::from(old)),
                            other => At::Exit(l, usize::from(other), old),
                        }
                    }
                    before => {
                        set(&mut self.prev, l, j, before);
                        At::Exit(l.saturating_sub(1), usize::from(before), j as u8)
                    }
                },
            };
        }
    }
}
