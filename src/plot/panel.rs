//! One pair of axes: what is drawn in it, its range, its ticks, and where its data lie.

use super::sheet::WIDTH;
use super::simplify::{columns, simplified};
use super::svg::{Anchor, Paint, Svg};
use super::{AxesMap, AxisMap};

/// Error that rounding to tenths of a pixel adds to a curve, px.
const ROUNDING: f64 = 0.07;
const AXIS: Paint = Paint::line("sd-axis", "#4d4d4d", 1.0);
const GRID: Paint = Paint::line("sd-grid", "#e2e2e2", 1.0);
const ZERO: Paint = Paint::line("sd-axis", "#4d4d4d", 0.6).faint(0.6);
/// Free space around the data, as a share of their range.
const PADDING: f64 = 0.06;

/// Something drawn in the coordinates of the data.
#[derive(Debug, PartialEq)]
pub(super) enum Shape {
    /// A curve; a point that is no number interrupts it.
    Curve { points: Vec<[f64; 2]>, paint: Paint },
    /// A closed outline.
    Outline { corners: Vec<[f64; 2]>, paint: Paint },
    /// Spans across in their order, over the whole height or in one of some rows above the lower edge.
    Bands { spans: Vec<[f64; 2]>, row: Option<usize>, paint: Paint },
    /// A dot of this radius in px.
    Dot { at: [f64; 2], radius: f64, paint: Paint },
    /// An arrow of this length in px towards a direction, rad from across.
    Arrow { at: [f64; 2], direction: f64, length: f64, paint: Paint },
}

/// Name, unit and field of what an axis measures.
#[derive(Debug, Clone, Copy)]
pub(super) struct Quantity {
    pub(super) name: &'static str,
    pub(super) unit: &'static str,
    pub(super) field: &'static str,
}

impl Quantity {
    fn label(&self) -> String {
        if self.unit.is_empty() { self.name.to_owned() } else { format!("{} ({})", self.name, self.unit) }
    }
}

/// A pair of axes before it has a place.
pub(super) struct Panel {
    pub(super) axes: &'static str,
    pub(super) title: String,
    pub(super) across: Quantity,
    pub(super) up: Quantity,
    pub(super) shapes: Vec<Shape>,
    /// Values that the axes must show beside the shapes.
    pub(super) shown: [Vec<f64>; 2],
    pub(super) height: f64,
    /// Whether both axes have the same scale.
    pub(super) equal: bool,
    /// Whether the values upwards fall.
    pub(super) up_falls: bool,
}

/// Smallest and largest of some values, none where there is no number.
pub(super) type Range = Option<[f64; 2]>;

pub(super) fn joined(one: Range, other: Range) -> Range {
    match (one, other) {
        (Some([low, high]), Some([other_low, other_high])) => Some([low.min(other_low), high.max(other_high)]),
        (range, None) | (None, range) => range,
    }
}

fn range_of(values: impl Iterator<Item = f64>) -> Range {
    values.filter(|value| value.is_finite()).map(|value| Some([value, value])).fold(None, joined)
}

impl Panel {
    /// The values that its shapes have along one axis.
    pub(super) fn range(&self, axis: usize) -> Range {
        let of_shape = |shape: &Shape| match shape {
            Shape::Curve { points, .. } | Shape::Outline { corners: points, .. } => {
                range_of(points.iter().map(|point| point[axis]))
            }
            Shape::Dot { at, .. } | Shape::Arrow { at, .. } => range_of([at[axis]].into_iter()),
            Shape::Bands { .. } => None,
        };
        self.shapes.iter().map(of_shape).fold(range_of(self.shown[axis].iter().copied()), joined)
    }
}

/// Where a panel is and what its axes show.
#[derive(Debug, Clone, Copy)]
pub(super) struct Frame {
    /// Left and right edge, then lower and upper edge, px.
    pub(super) px: [[f64; 2]; 2],
    /// The values at those edges.
    pub(super) data: [[f64; 2]; 2],
}

impl Frame {
    fn place(&self, point: [f64; 2]) -> [f64; 2] {
        std::array::from_fn(|axis| {
            let ([from, to], [low, high]) = (self.px[axis], self.data[axis]);
            from + (to - from) * (point[axis] - low) / (high - low)
        })
    }

    fn map(&self, panel: &Panel) -> AxesMap {
        let axis = |index: usize, quantity: Quantity| AxisMap {
            quantity: quantity.field,
            data: self.data[index],
            px: self.px[index],
        };
        AxesMap { axes: panel.axes, x: axis(0, panel.across), y: axis(1, panel.up) }
    }

    /// Draws the panel; gives where its data lie.
    pub(super) fn draw(&self, panel: &Panel, tolerance: f64, svg: &mut Svg) -> AxesMap {
        let [[left, right], [lower, upper]] = self.px;
        svg.text([left, upper - 7.0], Anchor::Start, 12.0, &panel.title);
        self.draw_ticks(panel, svg);
        for shape in &panel.shapes {
            if let Shape::Bands { spans, row, paint } = shape {
                let up = row.map_or(self.px[1], |row| [lower - 5.0 * row as f64, lower - 5.0 * row as f64 - 4.0]);
                self.draw_bands((spans, up), tolerance, paint, svg);
            }
        }
        for shape in &panel.shapes {
            self.draw_shape(shape, tolerance, svg);
        }
        svg.rectangle([left, lower], [right, upper], &AXIS);
        self.map(panel)
    }

    fn up_ticks(&self, panel: &Panel) -> Ticks {
        let ([lower, upper], [first, last]) = (self.px[1], self.data[1]);
        // Squares where both have one scale.
        let spacing = if panel.equal { TICK_SPACING } else { 27.0 };
        ticks([first.min(last), first.max(last)], (lower - upper) / spacing)
    }

    /// The room left of the panel that its numbers need, px.
    pub(super) fn room_of_labels(&self, panel: &Panel) -> f64 {
        8.0 + self.up_ticks(panel).label_width()
    }

    fn draw_ticks(&self, panel: &Panel, svg: &mut Svg) {
        let [[left, right], [lower, upper]] = self.px;
        let (across, up) = (ticks_across(self.data[0], right - left), self.up_ticks(panel));
        for tick in &across.values {
            let [x, _] = self.place([*tick, self.data[1][0]]);
            svg.line([x, lower], [x, upper], &GRID);
            let label = across.label(*tick);
            // At the edge of the figure it would be cut off.
            if x + 0.5 * width_of(&label) <= WIDTH {
                svg.text([x, lower + 15.0], Anchor::Middle, 11.0, &label);
            }
        }
        for tick in &up.values {
            let [_, y] = self.place([self.data[0][0], *tick]);
            let paint = if *tick == 0.0 && !panel.equal { &ZERO } else { &GRID };
            svg.line([left, y], [right, y], paint);
            svg.text([left - 6.0, y + 4.0], Anchor::End, 11.0, &up.label(*tick));
        }
        svg.text([f64::midpoint(left, right), lower + 31.0], Anchor::Middle, 12.0, &panel.across.label());
    }

    /// Draws spans across from one height to another, px, as one path. Gaps within the tolerance are closed.
    fn draw_bands(&self, (spans, [low, high]): (&[[f64; 2]], [f64; 2]), tolerance: f64, paint: &Paint, svg: &mut Svg) {
        let mut joined: Vec<[f64; 2]> = Vec::new();
        for [from, to] in spans.iter().map(|span| span.map(|value| self.place([value, self.data[1][0]])[0])) {
            match joined.last_mut() {
                Some(last) if from - last[1] <= tolerance => last[1] = to,
                _ => joined.push([from, to]),
            }
        }
        let outlines: Vec<_> =
            joined.into_iter().map(|[from, to]| [[from, low], [to, low], [to, high], [from, high]]).collect();
        svg.lines(outlines.iter().map(|outline| &outline[..]), true, paint);
    }

    fn draw_shape(&self, shape: &Shape, tolerance: f64, svg: &mut Svg) {
        match shape {
            Shape::Curve { points, paint } => {
                let parts = self.parts(points, tolerance.min(COARSEST)).into_iter().step_by(stride(tolerance));
                let parts = parts.map(|part| curve(&part, tolerance));
                svg.lines(parts.collect::<Vec<_>>().iter().map(Vec::as_slice), false, paint);
            }
            Shape::Outline { corners, paint } => {
                let corners: Vec<_> = corners.iter().map(|corner| self.place(*corner)).collect();
                svg.lines([&corners[..]].into_iter(), true, paint);
            }
            Shape::Dot { at, radius, paint } => svg.circle(self.place(*at), *radius, paint),
            Shape::Arrow { at, direction, length, paint } => {
                let from = self.place(*at);
                let towards = |from: [f64; 2], angle: f64, length: f64| {
                    [from[0] + length * angle.cos(), from[1] - length * angle.sin()]
                };
                let tip = towards(from, *direction, *length);
                let barb = |side: f64| towards(tip, direction + side * 2.6, 0.4 * length);
                svg.lines([&[from, tip][..], &[barb(1.0), tip, barb(-1.0)][..]].into_iter(), false, paint);
            }
            Shape::Bands { .. } => {}
        }
    }

    /// The places of the points between interruptions, of which those within the tolerance are none.
    fn parts(&self, points: &[[f64; 2]], tolerance: f64) -> Vec<Vec<[f64; 2]>> {
        let mut parts: Vec<Vec<[f64; 2]>> = Vec::new();
        for part in points.split(|point| !(point[0] + point[1]).is_finite()).filter(|part| !part.is_empty()) {
            let places = part.iter().map(|point| self.place(*point));
            let begin = self.place(part[0]);
            let is_near = |end: &[f64; 2]| (end[0] - begin[0]).hypot(end[1] - begin[1]) <= tolerance;
            match parts.last_mut() {
                Some(last) if last.last().is_some_and(is_near) => last.extend(places),
                _ => parts.push(places.collect()),
            }
        }
        parts
    }
}

/// Beyond this tolerance curves that do not run to the right are drawn by fewer of their points, px: so noise keeps its extent.
const COARSEST: f64 = 4.0;

/// One point of so many is drawn.
fn stride(tolerance: f64) -> usize {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "tolerances are few pixels")]
    let stride = (tolerance / COARSEST) as usize;
    stride.max(1)
}

/// The picture of a curve through these places.
fn curve(places: &[[f64; 2]], tolerance: f64) -> Vec<[f64; 2]> {
    let allowed = tolerance.min(COARSEST) - ROUNDING;
    if tolerance > super::TOLERANCE && places.is_sorted_by(|a, b| a[0] <= b[0]) {
        return simplified(&columns(places, tolerance), allowed);
    }
    let kept = simplified(places, allowed);
    let end = kept.last().copied().filter(|_| !(kept.len() - 1).is_multiple_of(stride(tolerance)));
    kept.into_iter().step_by(stride(tolerance)).chain(end).collect()
}

/// Distance of the ticks across, px.
const TICK_SPACING: f64 = 55.0;

/// The range that an axis shows for values in `range`: a little more, and never nothing.
pub(super) fn padded(range: Range, with_zero: bool) -> [f64; 2] {
    let Some([low, high]) = range else { return [0.0, 1.0] };
    let near_zero = with_zero || low.abs().min(high.abs()) < 0.5 * (high - low);
    let [low, high] = if near_zero { [low.min(0.0), high.max(0.0)] } else { [low, high] };
    // Less than this is rounding of the rollout, and around zero nothing at all.
    let least = if low.abs().max(high.abs()) < 1e-9 { 2.0 } else { 1e-4_f64.max(1e-6 * low.abs().max(high.abs())) };
    let missing = (least - (high - low)).max(0.0) / 2.0;
    let free = PADDING * (high - low).max(least);
    [low - missing - free, high + missing + free]
}

/// Ticks at round values.
pub(super) struct Ticks {
    pub(super) values: Vec<f64>,
    step: f64,
}

/// About `count` of them.
pub(super) fn ticks([low, high]: [f64; 2], count: f64) -> Ticks {
    let rough = (high - low) / count.max(1.5);
    let unit = 10_f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|of| of * unit).find(|step| *step >= 0.8 * rough).unwrap_or(unit);
    #[expect(clippy::cast_possible_truncation, reason = "an axis has few ticks")]
    let (first, last) = ((low / step - 1e-9).ceil() as i64, (high / step + 1e-9).floor() as i64);
    Ticks { values: (first..=last.min(first + 50)).map(|index| index as f64 * step).collect(), step }
}

/// As many on an axis across as have room for their numbers; px.
pub(super) fn ticks_across(range: [f64; 2], width: f64) -> Ticks {
    let usual = ticks(range, width / TICK_SPACING);
    let spacing = usual.label_width() + 13.0;
    if spacing <= TICK_SPACING { usual } else { ticks(range, width / spacing) }
}

/// The width of a number in the widest usual font, px.
fn width_of(number: &str) -> f64 {
    7.0 * number.chars().count() as f64
}

impl Ticks {
    /// The width of the longest number, px.
    pub(super) fn label_width(&self) -> f64 {
        self.values.iter().map(|tick| width_of(&self.label(*tick))).fold(0.0, f64::max)
    }

    /// What stands beside a tick.
    pub(super) fn label(&self, value: f64) -> String {
        let magnitude = |value: f64| value.abs().log10().floor();
        let largest = self.values.iter().fold(0.0_f64, |largest, value| largest.max(value.abs()));
        let of_step = magnitude(self.step);
        // Small steps between numbers that are not small have plain numbers too.
        let is_plain = (-5.0..5.0).contains(&of_step) || (of_step < 0.0 && magnitude(largest) >= -3.0);
        // As many digits as tell neighbours apart.
        let digits = if is_plain { -of_step } else { (magnitude(value) - of_step).max(1.0) };
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "no more than a double has")]
        let digits = digits.clamp(0.0, 17.0) as usize;
        let label = if is_plain { format!("{value:.digits$}") } else { format!("{value:.digits$e}") };
        label.replace('-', "\u{2212}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_within_the_range() {
        let labels = |range, count| {
            let ticks = ticks(range, count);
            ticks.values.iter().map(|value| ticks.label(*value)).collect::<Vec<_>>()
        };
        assert_eq!(labels([0.0, 2.93], 4.0), ["0", "1", "2"]);
        assert_eq!(labels([-0.11, 0.21], 4.0), ["\u{2212}0.1", "0.0", "0.1", "0.2"]);
        assert_eq!(labels([0.0, 3e-6], 3.0), ["0.0e0", "1.0e\u{2212}6", "2.0e\u{2212}6", "3.0e\u{2212}6"]);
        assert!(labels([1e8, 1e8 + 1.0], 3.0).len() >= 2);
        assert_eq!(labels([0.3, 0.300_02], 3.0), ["0.30000", "0.30001", "0.30002"]);
        assert_eq!(labels([0.3, 0.300_002], 3.0), ["0.300000", "0.300001", "0.300002"]);
        assert_eq!(labels([1e7, 1.1e7], 3.0), ["1.00e7", "1.05e7", "1.10e7"]);
    }

    #[test]
    fn places_and_data_map_onto_each_other() {
        let frame = Frame { px: [[50.0, 250.0], [180.0, 20.0]], data: [[0.0, 4.0], [-1.0, 1.0]] };
        assert_eq!(frame.place([0.0, -1.0]), [50.0, 180.0]);
        assert_eq!(frame.place([2.0, 0.0]), [150.0, 100.0]);
        assert_eq!(frame.place([4.0, 1.0]), [250.0, 20.0]);
    }

    #[test]
    fn every_range_has_a_length() {
        for (range, with_zero) in
            [(None, false), (Some([3.0, 3.0]), false), (Some([0.0, 0.0]), true), (Some([-1e8, -1e8]), false)]
        {
            let [low, high] = padded(range, with_zero);
            assert!(high - low >= 1e-4 && low <= range.map_or(1.0, |range| range[0]), "{range:?}: {low} {high}");
        }
        assert!(padded(Some([1.0, 5.0]), true)[0] <= 0.0);
    }
}
