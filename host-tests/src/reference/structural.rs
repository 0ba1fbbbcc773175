//! Generic rank by numbers: random entries on a zero pattern, row spaces by orthogonalisation. Knows no graphs.

type Vector = Vec<f64>;
type Matrix = Vec<Vector>;

/// Numbers from a seed (xorshift).
pub struct Dice(u64);

impl Dice {
    /// From a seed that is not 0.
    pub fn new(seed: u64) -> Self {
        Self(seed.max(1))
    }

    /// The next 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    /// 0 … n − 1.
    pub fn below(&mut self, n: u64) -> u64 {
        (self.bits() >> 11) % n
    }

    /// ±(0.5 … 2).
    pub fn entry(&mut self) -> f64 {
        let size = 0.5 + 1.5 * (self.bits() >> 11) as f64 / (1u64 << 53) as f64;
        if self.bits() >> 63 == 1 {
            size
        } else {
            -size
        }
    }
}

/// A pattern: one word per state, edges to states and, from bit n on, to outputs.
pub fn random_pattern(dice: &mut Dice, n: usize, m: usize) -> Vec<u64> {
    // From nearly empty to half full.
    let density = 1 + dice.below(5);
    (0..n)
        .map(|_| {
            let mut word = 0;
            for bit in 0..n + m {
                let odds = if bit < n { 10 } else { 4 * n as u64 };
                if dice.below(odds) < density {
                    word |= 1 << bit;
                }
            }
            word
        })
        .collect()
}

/// A[i][j] ≠ 0 where state j acts on i, C[k][j] ≠ 0 where output k sees j; random sizes.
pub fn instance(adj: &[u64], m: usize, dice: &mut Dice) -> (Matrix, Matrix) {
    let n = adj.len();
    let mut fill = |from: usize, rows: usize| -> Matrix {
        (0..rows)
            .map(|i| {
                adj.iter()
                    .map(|word| match word >> (from + i) & 1 {
                        1 => dice.entry(),
                        _ => 0.0,
                    })
                    .collect()
            })
            .collect()
    };
    (fill(0, n), fill(n, m))
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

/// Adds what is new of a row to an orthonormal basis.
pub fn extend(basis: &mut Matrix, row: &[f64]) -> bool {
    let length = dot(row, row).sqrt();
    if length == 0.0 {
        return false;
    }
    let mut new: Vector = row.iter().map(|x| x / length).collect();
    for _ in 0..2 {
        for b in basis.iter() {
            let along = dot(b, &new);
            new.iter_mut().zip(b).for_each(|(x, y)| *x -= along * y);
        }
    }
    let rest = dot(&new, &new).sqrt();
    // A direction of which 1e-7 was new is right to some 1e-9, so what depends on it leaves less than 1e-8. Something new
    // below 1e-7 is a coincidence of the draw (entries are 0.5 … 2, n ≤ 8).
    // Measured on the row as it came: where nothing acts, a unit vector times A is rounding of length 1e-17.
    if rest * length < 1e-7 {
        return false;
    }
    basis.push(new.iter().map(|x| x / rest).collect());
    true
}

fn times(row: &[f64], a: &Matrix) -> Vector {
    let n = row.len();
    (0..n)
        .map(|j| (0..n).map(|i| row[i] * a[i][j]).sum())
        .collect()
}

/// Orthonormal basis of the rows of [C; CA; …]: each new direction is multiplied by A in turn.
pub fn observable_space(a: &Matrix, c: &Matrix) -> Matrix {
    let mut basis = Matrix::new();
    for row in c {
        extend(&mut basis, row);
    }
    let mut next = 0;
    while next < basis.len() {
        let row = times(&basis[next], a);
        extend(&mut basis, &row);
        next += 1;
    }
    basis
}

/// States whose unit vector lies in the space, as bits.
pub fn alone(basis: &Matrix, n: usize) -> u32 {
    (0..n)
        .filter(|j| basis.iter().map(|b| b[*j] * b[*j]).sum::<f64>() > 1.0 - 1e-9)
        .fold(0, |set, j| set | 1 << j)
}

/// exp(A t) by its series.
pub fn exponential(a: &Matrix, t: f64) -> Matrix {
    let n = a.len();
    let unit = |i: usize| {
        (0..n)
            .map(|j| f64::from(u8::from(i == j)))
            .collect::<Vector>()
    };
    (0..n)
        .map(|i| {
            let (mut sum, mut term) = (unit(i), unit(i));
            for k in 1..60 {
                term = times(&term, a)
                    .iter()
                    .map(|x| x * t / f64::from(k))
                    .collect();
                sum.iter_mut().zip(&term).for_each(|(x, y)| *x += y);
            }
            sum
        })
        .collect()
}

/// Ranks of the stripped and of the total matrix of segments that share their start.
pub fn piecewise_ranks(segments: &[Matrix], c: &Matrix, duration: f64) -> (usize, usize) {
    let n = c[0].len();
    let (mut stripped, mut total) = (Matrix::new(), Matrix::new());
    let mut before: Matrix = exponential(&vec![vec![0.0; n]; n], 1.0);
    for a in segments {
        for row in observable_space(a, c) {
            extend(&mut stripped, &row);
            extend(&mut total, &times(&row, &before));
        }
        let phi = exponential(a, duration);
        before = phi.iter().map(|row| times(row, &before)).collect();
    }
    (stripped.len(), total.len())
}
