//! A map: a value over two others, as colours with lines of equal value; where there is none, the cell is hatched.

use super::contours::Field;
use super::panel::{Ticks, ticks, ticks_across};
use super::sheet::{LINE, WIDTH, wrapped};
use super::svg::{Anchor, Paint, Svg};

/// Left and upper edge of the map, where its numbers and its caption need no more, px.
const LEFT: f64 = 58.0;
const TOP: f64 = 82.0;
/// Lines of the caption that fit above it.
const CAPTION_LINES: usize = 2;
const HEIGHT: f64 = 380.0;
const RIGHT: f64 = 558.0;
/// Left and right edge of the scale of colours, px.
const SCALE: [f64; 2] = [582.0, 600.0];
/// Distance of the lines of a hatched cell, px.
const HATCH: f64 = 7.0;
/// Contours that are shorter have no label, px.
const SHORTEST_LABELLED: f64 = 70.0;

const AXIS: Paint = Paint::line("sd-axis", "#4d4d4d", 1.0);
const GRID: Paint = Paint::line("sd-grid", "#e2e2e2", 1.0);
const FAULT: Paint = Paint::line("sd-axis", "#4d4d4d", 0.9);
const MISSING: Paint = Paint::line("sd-track", "#9a9a9a", 0.7);
const CONTOUR: Paint = Paint::line("sd-contour", "#1a1a1a", 1.0);
const HALO: Paint = Paint::line("sd-halo", "#ffffff", 2.6).faint(0.45);
const LABEL: Paint = Paint::area("sd-label", "#ffffff", 0.75);

/// Viridis: equal steps look equal, also to the colour-blind and in grey, on white and on dark grounds.
const COLOURS: [&str; 32] = [
    "#470155", "#480d60", "#48186b", "#482474", "#472e7c", "#453882", "#434287", "#404c8a", "#3c548c", "#385d8d",
    "#33658e", "#2e6d8e", "#2a758e", "#257d8d", "#22858d", "#208c8c", "#1f948a", "#209c88", "#22a386", "#27ab82",
    "#2fb27d", "#39b976", "#46c06e", "#56c764", "#68cd59", "#7cd24c", "#92d73e", "#a9db31", "#c0df26", "#d7e21e",
    "#ebe51b", "#fce721",
];

/// A map before it is drawn.
#[derive(Debug, Clone)]
pub struct HeatMap {
    /// Its title.
    pub title: String,
    /// What else is to be said, below the title.
    pub caption: String,
    /// The axis across.
    pub across: MapAxis,
    /// The axis upwards.
    pub up: MapAxis,
    /// What the colours mean, with its unit.
    pub value: String,
    /// The cells, row by row upwards: as many as there are pairs of values of the axes.
    pub cells: Vec<MapCell>,
    /// What it means that nobody looked.
    pub missing: &'static str,
}

/// An axis of a map.
#[derive(Debug, Clone)]
pub struct MapAxis {
    /// What it measures, with its unit.
    pub label: String,
    /// Its values, rising.
    pub values: Vec<f64>,
}

/// What is known at a pair of values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum MapCell {
    /// A finite value.
    Value(f64),
    /// It was looked for, and there is none.
    None,
    /// There is no answer.
    Failed,
    /// Nobody looked yet.
    Missing,
}

impl HeatMap {
    /// The figure as SVG.
    ///
    /// # Panics
    /// When there are not as many cells as pairs, or an axis has no values.
    pub fn svg(&self) -> String {
        assert_eq!(self.cells.len(), self.across.values.len() * self.up.values.len(), "a cell per pair");
        let mut svg = Svg::default();
        svg.text([LEFT, 24.0], Anchor::Start, 15.0, &self.title);
        let caption = wrapped(&self.caption, 98);
        for (line, words) in caption.iter().enumerate() {
            svg.text([LEFT, 44.0 + LINE * line as f64], Anchor::Start, 12.0, words);
        }
        let grid = Grid::of(self, TOP + LINE * caption.len().saturating_sub(CAPTION_LINES) as f64);
        let [left, top] = [grid.left, grid.top];
        svg.text([LEFT, top - 8.0], Anchor::Start, 12.0, &self.up.label);
        grid.draw_axes(self, &mut svg);
        if let Some([low, high]) = self.range() {
            let levels = ticks([low, high], 7.0);
            grid.draw_colours(self, [low, high], &mut svg);
            let inner: Vec<_> = levels.values.iter().copied().filter(|level| *level > low && *level < high).collect();
            let mut labelled = Vec::new();
            for level in &inner {
                grid.draw_contour(self, (*level, &levels.label(*level)), &mut labelled, &mut svg);
            }
            draw_scale(
                (&self.value, top),
                [low, high],
                inner.iter().map(|level| (*level, levels.label(*level))),
                &mut svg,
            );
        }
        grid.draw_hatches(self, &mut svg);
        svg.rectangle([left, top], [RIGHT, top + HEIGHT], &AXIS);
        let below = self.draw_keys(top + HEIGHT, &mut svg);
        svg.document(WIDTH, below, &format!("{}. {}", self.title, self.caption))
    }

    /// The smallest and the largest value; apart also where all are equal.
    fn range(&self) -> Option<[f64; 2]> {
        let values = self.cells.iter().filter_map(|cell| cell.value());
        let [low, high] = values.fold(None, |range: Option<[f64; 2]>, value| {
            Some(range.map_or([value, value], |[low, high]| [low.min(value), high.max(value)]))
        })?;
        let least = (1e-9 * low.abs().max(high.abs())).max(1e-12);
        Some(if high - low > least { [low, high] } else { [low - least.max(0.5), high + least.max(0.5)] })
    }

    /// Says below the map what the hatches mean that are there; gives the height of the document.
    fn draw_keys(&self, lower: f64, svg: &mut Svg) -> f64 {
        let (mut x, y) = (LEFT, lower + 54.0);
        let keys = [(MapCell::None, "no plan"), (MapCell::Failed, "failed"), (MapCell::Missing, self.missing)];
        let present = keys.into_iter().filter(|(cell, _)| self.cells.contains(cell));
        for (cell, words) in present {
            let corners = [[x, y - 10.0], [x + 22.0, y + 2.0]];
            hatch(cell, &[corners], svg);
            svg.rectangle(corners[0], corners[1], &GRID);
            svg.text([x + 29.0, y], Anchor::Start, 12.0, words);
            x += 50.0 + 6.5 * words.len() as f64;
        }
        if x > LEFT { y + 14.0 } else { lower + 42.0 }
    }
}

impl MapCell {
    fn value(self) -> Option<f64> {
        match self {
            Self::Value(value) => Some(value),
            Self::None | Self::Failed | Self::Missing => None,
        }
    }
}

/// Where the cells are, px.
struct Grid {
    /// Left and upper edge of all.
    left: f64,
    top: f64,
    /// Edges of the columns from left to right, and of the rows from below.
    edges: [Vec<f64>; 2],
    /// Their middles: where the values are.
    middles: [Vec<f64>; 2],
    /// The values at the outer edges.
    ranges: [[f64; 2]; 2],
}

impl Grid {
    fn of(map: &HeatMap, top: f64) -> Self {
        let values = [&map.across.values, &map.up.values];
        let edges = values.map(|values| edges_of(values));
        let ranges = [0, 1].map(|axis: usize| {
            let edges = &edges[axis];
            [edges[0], edges[edges.len() - 1]]
        });
        let left = LEFT.max(12.0 + ticks_up(ranges[1]).label_width());
        let place = [[left, RIGHT], [top + HEIGHT, top]];
        let px = |axis: usize, value: f64| {
            let ([from, to], [low, high]) = (place[axis], ranges[axis]);
            from + (to - from) * (value - low) / (high - low)
        };
        let all_px = |axis: usize, values: &[f64]| values.iter().map(|value| px(axis, *value)).collect::<Vec<_>>();
        Self {
            left,
            top,
            middles: [0, 1].map(|axis| all_px(axis, values[axis])),
            edges: [0, 1].map(|axis| all_px(axis, &edges[axis])),
            ranges,
        }
    }

    /// The corners of a cell.
    fn corners(&self, index: usize) -> [[f64; 2]; 2] {
        let columns = self.middles[0].len();
        let (column, row) = (index % columns, index / columns);
        let [across, up] = &self.edges;
        [[across[column], up[row]], [across[column + 1], up[row + 1]]]
    }

    fn draw_axes(&self, map: &HeatMap, svg: &mut Svg) {
        let ([across, up], left, lower) = (self.ranges, self.left, self.top + HEIGHT);
        let of_across = ticks_across(across, RIGHT - left);
        for tick in &of_across.values {
            let x = left + (RIGHT - left) * (tick - across[0]) / (across[1] - across[0]);
            svg.line([x, lower], [x, lower + 4.0], &AXIS);
            svg.text([x, lower + 16.0], Anchor::Middle, 11.0, &of_across.label(*tick));
        }
        let of_up = ticks_up(up);
        for tick in &of_up.values {
            let y = lower - HEIGHT * (tick - up[0]) / (up[1] - up[0]);
            svg.line([left - 4.0, y], [left, y], &AXIS);
            svg.text([left - 7.0, y + 4.0], Anchor::End, 11.0, &of_up.label(*tick));
        }
        svg.text([f64::midpoint(left, RIGHT), lower + 32.0], Anchor::Middle, 12.0, &map.across.label);
    }

    /// One element per colour.
    fn draw_colours(&self, map: &HeatMap, range: [f64; 2], svg: &mut Svg) {
        let mut of_colour = vec![Vec::new(); COLOURS.len()];
        for (index, cell) in map.cells.iter().enumerate() {
            if let Some(value) = cell.value() {
                let [[left, lower], [right, upper]] = self.corners(index);
                of_colour[colour(value, range)].push([[left, lower], [right, lower], [right, upper], [left, upper]]);
            }
        }
        for (cells, fill) in of_colour.iter().zip(COLOURS) {
            // The line hides the seams between neighbours.
            let paint = Paint::line("sd-cell", fill, 0.5).filled(fill);
            svg.lines(cells.iter().map(|cell| &cell[..]), true, &paint);
        }
    }

    /// A contour with its label, unless that hides one that is there.
    fn draw_contour(
        &self,
        map: &HeatMap,
        (level, label): (f64, &str),
        labelled: &mut Vec<[[f64; 2]; 2]>,
        svg: &mut Svg,
    ) {
        let values: Vec<_> = map.cells.iter().map(|cell| cell.value().unwrap_or(f64::NAN)).collect();
        let lines = Field { across: &self.middles[0], up: &self.middles[1], values: &values }.lines(level);
        for paint in [&HALO, &CONTOUR] {
            svg.lines(lines.iter().map(Vec::as_slice), false, paint);
        }
        let longest = lines.iter().max_by(|one, other| length(one).total_cmp(&length(other)));
        if let Some(line) = longest.filter(|line| length(line) > SHORTEST_LABELLED) {
            let [x, y] = middle_of(line);
            let half = 3.2 * label.chars().count() as f64 + 3.0;
            let [from, to] = [[x - half, y - 7.0], [x + half, y + 7.0]];
            let hides =
                |other: &[[f64; 2]; 2]| (0..2).all(|axis| from[axis] < other[1][axis] && other[0][axis] < to[axis]);
            if !labelled.iter().any(hides) {
                labelled.push([from, to]);
                svg.rectangle(from, to, &LABEL);
                svg.text([x, y + 4.0], Anchor::Middle, 11.0, label);
            }
        }
    }

    fn draw_hatches(&self, map: &HeatMap, svg: &mut Svg) {
        for kind in [MapCell::None, MapCell::Failed, MapCell::Missing] {
            let of_kind = map.cells.iter().enumerate().filter(|(_, cell)| **cell == kind);
            let cells: Vec<_> = of_kind.map(|(index, _)| self.corners(index)).collect();
            hatch(kind, &cells, svg);
        }
    }
}

fn ticks_up(range: [f64; 2]) -> Ticks {
    ticks(range, 9.0)
}

/// Edges half way between the values, and as far beyond the outer ones.
fn edges_of(values: &[f64]) -> Vec<f64> {
    let (first, last) = (values[0], values[values.len() - 1]);
    let half_of = |pair: Option<&[f64]>| pair.map_or(0.5, |pair| 0.5 * (pair[1] - pair[0]));
    let (before, after) = (half_of(values.windows(2).next()), half_of(values.windows(2).next_back()));
    let between = values.windows(2).map(|pair| f64::midpoint(pair[0], pair[1]));
    std::iter::once(first - before).chain(between).chain([last + after]).collect()
}

fn colour(value: f64, [low, high]: [f64; 2]) -> usize {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of a short list")]
    let place = ((value - low) / (high - low) * COLOURS.len() as f64) as usize;
    place.min(COLOURS.len() - 1)
}

/// Lines upwards through cells, crossed ones where a row failed.
fn hatch(kind: MapCell, cells: &[[[f64; 2]; 2]], svg: &mut Svg) {
    let (paint, distance) = match kind {
        MapCell::Value(_) => return,
        MapCell::None | MapCell::Failed => (&FAULT, HATCH),
        MapCell::Missing => (&MISSING, 2.0 * HATCH),
    };
    let mut lines = Vec::new();
    for [[left, lower], [right, upper]] in cells {
        let (width, height) = (right - left, lower - upper);
        // Along the two sides of the corner at the upper left, each line at 45 degrees; one pattern over all cells.
        let mut at = (-left - upper).rem_euclid(distance);
        while at < width + height {
            let (along, down) = (at.min(width), at.min(height));
            let rising = [[left + at - down, upper + down], [left + along, upper + at - along]];
            lines.push(rising);
            if kind == MapCell::Failed {
                lines.push(rising.map(|[x, y]| [left + right - x, y]));
            }
            at += distance;
        }
    }
    svg.lines(lines.iter().map(|line| &line[..]), false, paint);
}

/// The scale of colours beside the map, with the levels of the lines.
fn draw_scale(
    (label, top): (&str, f64),
    [low, high]: [f64; 2],
    levels: impl Iterator<Item = (f64, String)>,
    svg: &mut Svg,
) {
    let [left, right] = SCALE;
    let step = HEIGHT / COLOURS.len() as f64;
    for (place, fill) in COLOURS.into_iter().enumerate() {
        let lower = top + HEIGHT - step * place as f64;
        // Over the edge to the next colour, which hides it.
        let upper = (lower - step - 0.5).max(top);
        svg.rectangle([left, lower], [right, upper], &Paint::area("sd-cell", fill, 1.0));
    }
    svg.rectangle([left, top], [right, top + HEIGHT], &AXIS);
    for (level, words) in levels {
        let y = top + HEIGHT - HEIGHT * (level - low) / (high - low);
        svg.line([left, y], [right, y], &CONTOUR);
        svg.text([right + 6.0, y + 4.0], Anchor::Start, 11.0, &words);
    }
    svg.text([WIDTH - 12.0, top - 8.0], Anchor::End, 12.0, label);
}

fn length(line: &[[f64; 2]]) -> f64 {
    line.windows(2).map(|pair| distance(pair[0], pair[1])).sum()
}

fn distance(from: [f64; 2], to: [f64; 2]) -> f64 {
    (to[0] - from[0]).hypot(to[1] - from[1])
}

/// The point half way along a line.
fn middle_of(line: &[[f64; 2]]) -> [f64; 2] {
    let mut rest = 0.5 * length(line);
    for pair in line.windows(2) {
        let step = distance(pair[0], pair[1]);
        if step >= rest && step > 0.0 {
            let share = rest / step;
            return [0, 1].map(|axis| pair[0][axis] + share * (pair[1][axis] - pair[0][axis]));
        }
        rest -= step;
    }
    line[0]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn axis(count: u32) -> MapAxis {
        MapAxis { label: "goal y (m)".to_owned(), values: (0..count).map(f64::from).collect() }
    }

    fn map(cells: Vec<MapCell>, columns: u32, rows: u32) -> HeatMap {
        let (title, caption, value) = ("A < B".to_owned(), String::new(), "final time (s)".to_owned());
        HeatMap { title, caption, across: axis(columns), up: axis(rows), value, cells, missing: "not run yet" }
    }

    #[test]
    fn cells_have_colours_and_hatches_have_keys() {
        let cells = vec![MapCell::Value(1.0), MapCell::Value(2.0), MapCell::None, MapCell::Missing];
        let svg = map(cells, 2, 2).svg();
        for word in ["A &lt; B", COLOURS[0], COLOURS[31], "no plan", "not run yet", "goal y (m)", "final time (s)"] {
            assert!(svg.contains(word), "{word}: {svg}");
        }
        assert!(!svg.contains("failed") && !svg.contains("NaN"));
    }

    #[test]
    fn colours_rise_evenly_with_the_value() {
        let place = |value| colour(value, [10.0, 42.0]);
        assert_eq!([10.0, 10.9, 11.1, 25.9, 26.1, 41.9, 42.0].map(place), [0, 0, 1, 15, 16, 31, 31]);
    }

    #[test]
    fn maps_without_spread_or_values_can_be_drawn() {
        for cells in [vec![MapCell::Value(3.0)], vec![MapCell::Failed], vec![MapCell::Value(0.0)]] {
            let svg = map(cells, 1, 1).svg();
            assert!(svg.starts_with("<svg") && !svg.contains("NaN") && !svg.contains("inf"), "{svg}");
        }
    }

    #[test]
    fn long_captions_and_long_numbers_have_room() {
        let plain = map(vec![MapCell::Value(1.0)], 1, 1);
        let left_and_top = |map: &HeatMap| {
            let grid = Grid::of(map, 0.0);
            let lines = wrapped(&map.caption, 98).len();
            (grid.left, map.svg().contains(&format!("y=\"{}\"", TOP + LINE * lines.saturating_sub(2) as f64 - 8.0)))
        };
        assert_eq!(left_and_top(&plain), (LEFT, true));
        let caption = "chosen ".repeat(50);
        assert_eq!(left_and_top(&HeatMap { caption, ..plain.clone() }), (LEFT, true));
        let up = MapAxis { values: vec![5.5e-4, 5.5001e-4], ..axis(2) };
        let (left, _) = left_and_top(&HeatMap { up, cells: vec![MapCell::Missing; 2], ..plain });
        assert!(left > LEFT + 7.0, "{left}");
    }

    #[test]
    fn labels_of_contours_do_not_overlap() {
        let counts = |svg: &str| ["sd-label", "sd-contour"].map(|class| svg.matches(class).count());
        // A cliff from 0 to 10: its four lines run side by side within the distance of two cells. Each has a mark at the scale.
        let cells = (0..60 * 60).map(|index| MapCell::Value(if index % 60 < 30 { 0.0 } else { 10.0 }));
        assert_eq!(counts(&map(cells.collect(), 60, 60).svg()), [1, 8]);
        // A slope over the whole width, with five.
        let cells = (0..60 * 60).map(|index| MapCell::Value(f64::from(index % 60)));
        assert_eq!(counts(&map(cells.collect(), 60, 60).svg()), [5, 10]);
    }

    #[test]
    fn edges_are_half_way() {
        assert_eq!(edges_of(&[1.0, 2.0, 4.0]), [0.5, 1.5, 3.0, 5.0]);
        assert_eq!(edges_of(&[1.0]), [0.5, 1.5]);
    }
}
