//! Which way a sensor's axes point in the body: `x,-y,-z`.

use std::str::FromStr;

/// Body axes (right, forward, up) in terms of the sensor's own: `y,x,-z` means right = sensor y, forward = sensor x,
/// up = −sensor z (a sensor with forward-right-down axes).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axes([(usize, f64); 3]);

impl Default for Axes {
    fn default() -> Self {
        Self([(0, 1.0), (1, 1.0), (2, 1.0)])
    }
}

impl Axes {
    /// A vector of the sensor in body axes.
    pub fn apply(&self, v: [f64; 3]) -> [f64; 3] {
        self.0.map(|(i, sign)| sign * v[i])
    }
}

impl FromStr for Axes {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut axes = Vec::new();
        for name in text.split(',') {
            let (sign, axis) = match name.trim().as_bytes() {
                [b'-', axis] => (-1.0, axis),
                [b'+', axis] | [axis] => (1.0, axis),
                _ => return Err(format!("\"{name}\" is not one of x, -x, y, -y, z, -z")),
            };
            let index = match axis {
                b'x' => 0,
                b'y' => 1,
                b'z' => 2,
                _ => return Err(format!("\"{name}\" is not one of x, -x, y, -y, z, -z")),
            };
            axes.push((index, sign));
        }
        let axes: [(usize, f64); 3] = axes
            .try_into()
            .map_err(|_| "three axes are needed, as in x,-y,-z".to_owned())?;
        let [(i, a), (j, b), (k, c)] = axes;
        if i == j || j == k || i == k {
            return Err("each of x, y, z must stand once, as in x,-y,-z".into());
        }
        let even = (j + 3 - i) % 3 == 1; // x,y,z and its cyclic shifts
        if (a * b * c > 0.0) != even {
            return Err("these axes are left-handed, a mirror image that no turn can make".into());
        }
        Ok(Self(axes))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_turns_are_accepted() {
        let forward_right_down: Axes = "y,x,-z".parse().unwrap();
        assert_eq!(forward_right_down.apply([1.0, 2.0, 3.0]), [2.0, 1.0, -3.0]);
        assert_eq!(
            "x,-y,-z".parse::<Axes>().unwrap().apply([1.0, 2.0, 3.0]),
            [1.0, -2.0, -3.0]
        );
        assert_eq!(
            "y,z,x".parse::<Axes>().unwrap().apply([1.0, 2.0, 3.0]),
            [2.0, 3.0, 1.0]
        );
        for wrong in [
            "x,y,-z", "y,x,z", "x,x,z", "x,y", "x,y,z,x", "a,y,z", "", "--x,y,z",
        ] {
            assert!(wrong.parse::<Axes>().is_err(), "{wrong}");
        }
    }
}
