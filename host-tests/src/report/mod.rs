//! Reports for people: one HTML file that needs nothing else, and the same tables for a terminal.

pub mod graph;
mod page;
pub mod plot;
mod table;

pub use page::{write_file, Page, Tone};
pub use plot::{Band, Chart, Scale, Series};
pub use table::{Cell, Table};

/// A number in the fewest digits that a reader needs: four significant ones, an exponent where it is tiny or huge.
pub fn short(x: f64) -> String {
    digits(x, 4)
}

/// A number with so many significant digits; "n/a" where there is none.
pub fn digits(x: f64, significant: usize) -> String {
    if !x.is_finite() {
        return "n/a".into();
    }
    if x == 0.0 {
        return "0".into();
    }
    let exponent = format!("{:.*e}", significant - 1, x);
    let power: i32 = exponent
        .split('e')
        .nth(1)
        .and_then(|p| p.parse().ok())
        .unwrap_or(0);
    if (-3..6).contains(&power) {
        let places = (significant as i32 - 1 - power).max(0) as usize;
        format!("{x:.places$}")
    } else {
        exponent
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_keep_four_digits() {
        for (x, text) in [
            (0.0, "0"),
            (12345.6, "12346"),
            (1.23456, "1.235"),
            (-0.012345, "-0.01235"),
            (9999.96, "10000"),
            (1.2e-7, "1.200e-7"),
            (4.2e7, "4.200e7"),
            (f64::NAN, "n/a"),
            (f64::INFINITY, "n/a"),
        ] {
            assert_eq!(short(x), text);
        }
    }
}
