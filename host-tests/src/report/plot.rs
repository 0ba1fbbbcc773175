//! Line charts as SVG text.
//!
//! The drawing library places everything on whole pixels, so a chart is drawn `FINE` times larger than it is shown
//! and scaled down by its view box.

use std::ops::Range;

use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, ValueFormatter};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// Drawing pixels per shown pixel.
const FINE: u32 = 4;
/// Most points that a line is drawn with; more than the picture can show is left out.
const POINTS: usize = 400;
const INK: RGBColor = RGBColor(30, 41, 59);
const SOFT: RGBColor = RGBColor(100, 116, 139);
const GRID: RGBColor = RGBColor(226, 232, 240);

/// A line.
#[derive(Clone, Debug)]
pub struct Series {
    /// What it is, for the key; empty for none.
    pub label: String,
    /// Colour as `#rrggbb`.
    pub color: &'static str,
    /// Shown width.
    pub width: u32,
    /// Points; one that is not finite, not positive on a logarithmic scale, or off the chart leaves a gap.
    pub points: Vec<(f64, f64)>,
}

/// A tinted interval.
#[derive(Clone, Debug)]
pub struct Band {
    /// From where to where.
    pub range: Range<f64>,
    /// Colour as `#rrggbb`, a light one.
    pub color: &'static str,
    /// Written into it where there is room; empty for nothing.
    pub label: String,
}

impl Band {
    /// In the usual colour, without a word.
    pub fn plain(range: Range<f64>) -> Self {
        Self {
            range,
            color: "#fef3c7",
            label: String::new(),
        }
    }
}

/// Vertical axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// Equal steps.
    Linear,
    /// Equal factors.
    Logarithmic,
}

/// An axis whose ticks are chosen here.
#[derive(Clone)]
struct Axis {
    range: Range<f64>,
    ticks: Vec<f64>,
    scale: Scale,
}

impl Ranged for Axis {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        let share = (value - self.range.start) / (self.range.end - self.range.start);
        limit.0 + (share * f64::from(limit.1 - limit.0)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        match hint.weight().allow_light_points() {
            true => Vec::new(),
            false => self.ticks.clone(),
        }
    }

    fn range(&self) -> Range<f64> {
        self.range.clone()
    }
}

impl ValueFormatter<f64> for Axis {
    fn format_ext(&self, value: &f64) -> String {
        match self.scale {
            Scale::Linear => tick_label(*value),
            Scale::Logarithmic => power_label(*value),
        }
    }
}

/// What to draw.
#[derive(Clone, Debug)]
pub struct Chart {
    /// Line above the picture.
    pub title: String,
    /// Quantity and unit along x; empty for none.
    pub x_label: String,
    /// Distance of the ticks along x, where round numbers are not the natural ones, as for angles.
    pub x_step: Option<f64>,
    /// Vertical axis.
    pub scale: Scale,
    /// Ends of the vertical axis, where they should not follow the data.
    pub y_range: Option<Range<f64>>,
    /// Values that the vertical axis reaches at least.
    pub y_includes: Option<Range<f64>>,
    /// Intervals to tint.
    pub bands: Vec<Band>,
    /// A path in a plane and not a value over x: one unit is as long along both axes, and no point is left out.
    pub path: bool,
    /// Level to mark.
    pub level: Option<f64>,
    /// Lines.
    pub series: Vec<Series>,
    /// Shown width and height.
    pub size: (u32, u32),
}

impl Chart {
    /// A chart of the usual size.
    pub fn new(title: impl Into<String>, scale: Scale, series: Vec<Series>) -> Self {
        Self {
            title: title.into(),
            x_label: String::new(),
            x_step: None,
            scale,
            y_range: None,
            y_includes: None,
            bands: Vec::new(),
            path: false,
            level: None,
            series,
            size: (340, 190),
        }
    }

    /// The picture as one `<svg>` element.
    pub fn svg(&self) -> String {
        let mut text = String::new();
        let size = (self.size.0 * FINE, self.size.1 * FINE);
        let root = SVGBackend::with_string(&mut text, size).into_drawing_area();
        // Writing into a string cannot fail, and ranges are finite by construction.
        if self
            .draw(&root)
            .and_then(|()| root.present().map_err(drop))
            .is_err()
        {
            return String::new();
        }
        drop(root);
        let fixed = format!("width=\"{}\" height=\"{}\" ", size.0, size.1);
        text.replacen(&fixed, "role=\"img\" ", 1).replace(
            "font-family=\"sans-serif\"",
            "font-family=\"system-ui, sans-serif\"",
        )
    }

    fn draw(&self, root: &DrawingArea<SVGBackend<'_>, plotters::coord::Shift>) -> Result<(), ()> {
        let on_axis = |y: f64| match self.scale {
            Scale::Linear => y,
            Scale::Logarithmic => y.log10(),
        };
        let chosen = self
            .y_range
            .as_ref()
            .map(|r| on_axis(r.start)..on_axis(r.end));
        let seen = chosen.clone().unwrap_or(f64::NEG_INFINITY..f64::INFINITY);
        let lines: Vec<Vec<Vec<(f64, f64)>>> = self
            .series
            .iter()
            .map(|s| pieces(s.points.iter().map(|p| (p.0, on_axis(p.1))), &seen))
            .collect();
        let all = || lines.iter().flatten().flatten();
        let x = span(all().map(|p| p.0), 0.0).unwrap_or(0.0..1.0);
        let level = self.level.map(on_axis);
        let included = self.y_includes.iter().flat_map(|r| [r.start, r.end]);
        let y = chosen
            .or_else(|| {
                span(
                    all().map(|p| p.1).chain(level).chain(included.map(on_axis)),
                    0.06,
                )
            })
            .unwrap_or(0.0..1.0);
        // the names of the bands stand above the lines
        let labelled = self.bands.iter().any(|band| !band.label.is_empty());
        let y = match labelled && self.y_range.is_none() {
            true => y.start..y.end + 0.08 * (y.end - y.start),
            false => y,
        };
        let (x, y) = if self.path { self.even(x, y) } else { (x, y) };
        let px = |n: u32| n * FINE;
        let font = |n: u32, color: &RGBColor| ("sans-serif", px(n)).into_font().color(color);

        let x_axis = Axis {
            ticks: match self.x_step {
                Some(step) => multiples(&x, step),
                None => ticks(&x, 6),
            },
            range: x.clone(),
            scale: Scale::Linear,
        };
        let y_axis = Axis {
            ticks: match self.scale {
                Scale::Linear => ticks(&y, 5),
                Scale::Logarithmic => decades(&y, 5),
            },
            range: y.clone(),
            scale: self.scale,
        };
        let x_room = if self.x_label.is_empty() { 22 } else { 34 };
        let mut chart = ChartBuilder::on(root)
            .margin_top(px(if self.title.is_empty() { 8 } else { 26 }))
            .margin_right(px(14))
            .margin_left(px(4))
            .set_label_area_size(LabelAreaPosition::Left, px(46))
            .set_label_area_size(LabelAreaPosition::Bottom, px(x_room))
            .build_cartesian_2d(x_axis, y_axis)
            .map_err(drop)?;
        root.draw(&Text::new(
            self.title.clone(),
            (px(12) as i32, px(6) as i32),
            font(13, &INK),
        ))
        .map_err(drop)?;
        for band in &self.bands {
            let (from, to) = (band.range.start.max(x.start), band.range.end.min(x.end));
            if from < to {
                let area = [(from, y.start), (to, y.end)];
                chart
                    .draw_series([Rectangle::new(area, color(band.color).filled())])
                    .map_err(drop)?;
            }
        }
        chart
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .bold_line_style(ShapeStyle::from(GRID).stroke_width(FINE))
            .axis_style(ShapeStyle::from(SOFT).stroke_width(FINE))
            .label_style(font(11, &SOFT))
            .axis_desc_style(font(11, &SOFT))
            .x_desc(self.x_label.clone())
            .set_all_tick_mark_size(px(4))
            .draw()
            .map_err(drop)?;
        if let Some(level) = level {
            let style = ShapeStyle::from(SOFT).stroke_width(FINE);
            let path = [(x.start, level), (x.end, level)];
            chart
                .draw_series(DashedLineSeries::new(path, px(4), px(3), style))
                .map_err(drop)?;
        }
        self.band_labels(&mut chart, &x, &y)?;
        for (series, parts) in self.series.iter().zip(&lines) {
            let style = ShapeStyle::from(color(series.color)).stroke_width(FINE * series.width);
            for part in parts {
                let points = if self.path { part.clone() } else { thin(part) };
                chart
                    .draw_series(LineSeries::new(points, style))
                    .map_err(drop)?;
            }
        }
        self.key(root, &font(11, &INK))
    }

    /// Names of the bands, below their upper ends, where they fit.
    fn band_labels<'a, DB: DrawingBackend + 'a>(
        &self,
        chart: &mut ChartContext<'a, DB, Cartesian2d<Axis, Axis>>,
        x: &Range<f64>,
        y: &Range<f64>,
    ) -> Result<(), ()> {
        let plot = f64::from(self.size.0.saturating_sub(64));
        let size = 9 * FINE;
        for band in self.bands.iter().filter(|b| !b.label.is_empty()) {
            let (from, to) = (band.range.start.max(x.start), band.range.end.min(x.end));
            let room = (to - from) / (x.end - x.start) * plot;
            // half of the height of a letter is its mean width
            if room < 4.8 * band.label.chars().count() as f64 + 4.0 {
                continue;
            }
            let style = ("sans-serif", size)
                .into_font()
                .color(&SOFT)
                .pos(Pos::new(HPos::Center, VPos::Top));
            let top = y.end - 0.02 * (y.end - y.start);
            chart
                .draw_series([Text::new(
                    band.label.clone(),
                    (0.5 * (from + to), top),
                    style,
                )])
                .map_err(drop)?;
        }
        Ok(())
    }

    /// Ranges that show one unit as long along both axes.
    fn even(&self, x: Range<f64>, y: Range<f64>) -> (Range<f64>, Range<f64>) {
        let plot = (
            f64::from(self.size.0.saturating_sub(64)),
            f64::from(self.size.1.saturating_sub(60)),
        );
        let unit = ((x.end - x.start) / plot.0).max((y.end - y.start) / plot.1);
        let around = |r: &Range<f64>, pixels: f64| {
            let (middle, half) = (0.5 * (r.start + r.end), 0.53 * unit * pixels);
            middle - half..middle + half
        };
        (around(&x, plot.0), around(&y, plot.1))
    }

    /// Names of the lines, in the top right corner, right to left.
    fn key(
        &self,
        root: &DrawingArea<SVGBackend<'_>, plotters::coord::Shift>,
        font: &TextStyle<'_>,
    ) -> Result<(), ()> {
        let fine = FINE as i32;
        let mut right = (self.size.0 as i32 - 14) * fine;
        let middle = 13 * fine;
        let style = font.pos(Pos::new(HPos::Right, VPos::Center));
        for series in self.series.iter().rev().filter(|s| !s.label.is_empty()) {
            root.draw(&Text::new(
                series.label.clone(),
                (right, middle),
                style.clone(),
            ))
            .map_err(drop)?;
            right -= (series.label.chars().count() as i32 * 5 + 8) * fine;
            let stroke = ShapeStyle::from(color(series.color)).stroke_width(FINE * 2);
            root.draw(&PathElement::new(
                [(right - 16 * fine, middle), (right, middle)],
                stroke,
            ))
            .map_err(drop)?;
            right -= 26 * fine;
        }
        Ok(())
    }
}

/// Cuts a line where a point cannot be drawn.
fn pieces(points: impl Iterator<Item = (f64, f64)>, seen: &Range<f64>) -> Vec<Vec<(f64, f64)>> {
    let mut parts = vec![Vec::new()];
    for (x, y) in points {
        let drawable = x.is_finite() && y.is_finite() && seen.contains(&y);
        match parts.last_mut() {
            Some(part) if drawable => part.push((x, y)),
            Some(part) if part.is_empty() => {}
            _ => parts.push(Vec::new()),
        }
    }
    parts
}

/// Smallest and largest value with some room around them.
fn span(values: impl Iterator<Item = f64>, room: f64) -> Option<Range<f64>> {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for v in values {
        (low, high) = (low.min(v), high.max(v));
    }
    if low > high {
        return None;
    }
    let width = high - low;
    // A constant line: any room will do, as long as the two ends differ.
    let room = if width > 1e-9 * high.abs() {
        room * width
    } else {
        0.5 * high.abs().max(1e-3)
    };
    Some(low - room..high + room)
}

/// About `count` round numbers inside a range.
fn ticks(range: &Range<f64>, count: usize) -> Vec<f64> {
    let raw = (range.end - range.start) / count as f64;
    let power = 10f64.powf(raw.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0]
        .map(|m| m * power)
        .into_iter()
        .find(|s| *s >= raw * 0.999)
        .unwrap_or(raw);
    multiples(range, step)
}

/// All multiples of a step inside a range.
fn multiples(range: &Range<f64>, step: f64) -> Vec<f64> {
    let first = (range.start / step - 1e-9).ceil() as i64;
    let last = (range.end / step + 1e-9).floor() as i64;
    (first..=last).map(|i| i as f64 * step).collect()
}

/// Whole powers of ten inside a range of logarithms; 1-2-5 or round numbers where there are fewer than two.
fn decades(range: &Range<f64>, count: usize) -> Vec<f64> {
    let (first, last) = (range.start.ceil() as i64, range.end.floor() as i64);
    if last - first >= 1 {
        let step = ((last - first) as usize / count + 1) as i64;
        return (first..=last)
            .filter(|i| i.rem_euclid(step) == 0)
            .map(|i| i as f64)
            .collect();
    }
    let steps: Vec<f64> = (range.start.floor() as i32..=range.end.ceil() as i32)
        .flat_map(|i| [1.0, 2.0, 5.0].map(|m: f64| m.log10() + f64::from(i)))
        .filter(|v| range.contains(v))
        .collect();
    if steps.len() >= 2 {
        return steps;
    }
    ticks(&(10f64.powf(range.start)..10f64.powf(range.end)), count)
        .into_iter()
        .filter(|v| *v > 0.0)
        .map(f64::log10)
        .collect()
}

fn tick_label(v: f64) -> String {
    if v == 0.0 || (1e-4..1e5).contains(&v.abs()) {
        let text = format!("{v:.5}");
        return text.trim_end_matches('0').trim_end_matches('.').to_owned();
    }
    let text = format!("{v:.2e}");
    match text.split_once('e') {
        Some((mantissa, power)) => {
            let mantissa = mantissa.trim_end_matches('0').trim_end_matches('.');
            format!("{mantissa}·10{}", raised(power))
        }
        None => text,
    }
}

/// Label of a logarithm: a power of ten, or the number itself.
fn power_label(v: f64) -> String {
    let whole = (v - v.round()).abs() < 1e-9;
    if whole && !(-2.5..4.5).contains(&v) {
        format!("10{}", raised(&format!("{:.0}", v)))
    } else {
        tick_label(10f64.powf(v) * (1.0 + 1e-14))
    }
}

/// Digits as superscripts.
fn raised(power: &str) -> String {
    power
        .chars()
        .map(|c| match c {
            '-' => '⁻',
            '1' => '¹',
            '2' => '²',
            '3' => '³',
            d => d
                .to_digit(10)
                .and_then(|d| char::from_u32(0x2070 + d))
                .unwrap_or(d),
        })
        .collect()
}

/// Leaves out points that the picture cannot show, keeping the ends and the extremes of each stretch.
fn thin(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    if points.len() <= POINTS {
        return points.to_vec();
    }
    let stretch = points.len().div_ceil(POINTS / 2);
    let mut kept = Vec::with_capacity(POINTS);
    for part in points.chunks(stretch) {
        let by_y = |a: &&(f64, f64), b: &&(f64, f64)| a.1.total_cmp(&b.1);
        if let (Some(low), Some(high)) = (part.iter().min_by(by_y), part.iter().max_by(by_y)) {
            let (first, second) = if low.0 <= high.0 {
                (low, high)
            } else {
                (high, low)
            };
            kept.push(*first);
            if second != first {
                kept.push(*second);
            }
        }
    }
    kept.extend(points.last().filter(|p| kept.last() != Some(p)).copied());
    kept
}

fn color(text: &str) -> RGBColor {
    let channel = |from: usize| {
        text.get(from..from + 2)
            .and_then(|h| u8::from_str_radix(h, 16).ok())
            .unwrap_or(0)
    };
    RGBColor(channel(1), channel(3), channel(5))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(points: Vec<(f64, f64)>) -> Series {
        Series {
            label: "a".into(),
            color: "#2563eb",
            width: 2,
            points,
        }
    }

    #[test]
    fn nothing_and_impossible_numbers_still_make_a_picture() {
        for scale in [Scale::Linear, Scale::Logarithmic] {
            for points in [
                vec![],
                vec![(0.0, f64::NAN)],
                vec![(0.0, 0.0), (1.0, -1.0)],
                vec![(0.0, 3.0), (1.0, 3.0)],
                vec![(0.0, 1e-30), (f64::INFINITY, 2.0), (2.0, 1e30)],
            ] {
                let svg = Chart::new("t", scale, vec![line(points)]).svg();
                assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"));
            }
        }
    }

    #[test]
    fn ticks_are_round_and_inside() {
        assert_eq!(
            ticks(&(300.0..550.0), 5),
            [300.0, 350.0, 400.0, 450.0, 500.0, 550.0]
        );
        assert_eq!(decades(&(-6.3..-2.9), 5), [-6.0, -5.0, -4.0, -3.0]);
        assert_eq!(decades(&(-12.0..3.0), 5), [-12.0, -8.0, -4.0, 0.0]);
        let close = decades(&(400f64.log10()..430f64.log10()), 3);
        assert_eq!(
            close.into_iter().map(power_label).collect::<Vec<_>>(),
            ["400", "410", "420", "430"]
        );
    }

    #[test]
    fn labels_are_short() {
        assert_eq!(tick_label(0.30000000000000004), "0.3");
        assert_eq!(tick_label(2e-6), "2·10⁻⁶");
        assert_eq!(power_label(-12.0), "10⁻¹²");
        assert_eq!(power_label(2.0), "100");
        assert_eq!(power_label(5f64.log10()), "5");
    }

    #[test]
    fn a_long_line_keeps_its_ends_and_its_extremes() {
        let points: Vec<_> = (0..10_000)
            .map(|i| (f64::from(i), if i == 4321 { 9.0 } else { 0.0 }))
            .collect();
        let thin = thin(&points);
        assert!(thin.len() <= POINTS + 2 && thin.contains(&(4321.0, 9.0)));
        assert_eq!((thin.first(), thin.last()), (points.first(), points.last()));
    }
}
