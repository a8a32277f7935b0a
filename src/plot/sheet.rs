//! A figure of panels: title, legend and notes above rows of panels.

use super::panel::{Frame, Panel, Range, joined, padded};
use super::svg::{Anchor, Paint, Svg};
use super::{Figure, LARGEST_FIGURE, Plan, TOLERANCE};

/// Width of all figures, px: a page's column, and 17 cm on paper at the size of its text.
pub(super) const WIDTH: f64 = 680.0;
/// Room for the numbers left of a panel, and between panels, px; longer numbers have more.
const LEFT: f64 = 54.0;
/// Room right of the last panel, px.
const RIGHT: f64 = 12.0;
/// Room for the title above a panel and for numbers and name below, px.
const ABOVE: f64 = 26.0;
const BELOW: f64 = 38.0;
/// Height of a line of text, px.
pub(super) const LINE: f64 = 17.0;
/// Coarser where a figure would be too large; the last leaves hardly anything.
const COARSER: [f64; 9] = [0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 64.0, 256.0, 1024.0];

/// Colours and dashes of the plans: those of Okabe and Ito that stand out from white and from dark grounds.
const PLANS: [Paint; 4] = [
    Paint::line("sd-plan-a", "#0072b2", 1.8),
    Paint::line("sd-plan-b", "#d55e00", 1.8).dashed("7 3"),
    Paint::line("sd-plan-c", "#009e73", 1.8).dashed("2 2.5"),
    Paint::line("sd-plan-d", "#b0538a", 1.8).dashed("9 3 2 3"),
];
/// Spans in which a wheel slips, by plan.
const BANDS: [Paint; 4] = [
    Paint::area("sd-slip-area", "#e69f00", 0.28),
    Paint::area("sd-slip-area-b", "#d55e00", 0.75),
    Paint::area("sd-slip-area-c", "#009e73", 0.75),
    Paint::area("sd-slip-area-d", "#b0538a", 0.75),
];
const FIRST_BAND_OF_SEVERAL: Paint = Paint::area("sd-slip-area-a", "#0072b2", 0.75);
/// What must not be passed.
pub(super) const LIMIT: Paint = Paint::line("sd-limit", "#4d4d4d", 1.2).dashed("4 3");
/// A wheel that slips.
pub(super) const SLIP: Paint = Paint::line("sd-slip", "#e69f00", 3.5);
/// What is asked of the end.
pub(super) const GOAL: Paint = Paint::line("sd-goal", "#1a1a1a", 1.5);

/// The paint of a plan's curves.
pub(super) fn paint_of(plan: usize) -> Paint {
    PLANS[plan % PLANS.len()]
}

/// The paint of a plan's slip spans, and their row where there are several plans.
pub(super) fn band_of(plan: usize, plan_count: usize) -> (Option<usize>, Paint) {
    match (plan, plan_count) {
        (0, 1) => (None, BANDS[0]),
        (0, _) => (Some(0), FIRST_BAND_OF_SEVERAL),
        _ => (Some(plan), BANDS[plan % BANDS.len()]),
    }
}

/// How an entry of a legend shows its paint.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Sample {
    Line,
    Area,
    Circle,
}

/// An entry of a legend.
pub(super) struct Key {
    pub(super) paint: Paint,
    sample: Sample,
    pub(super) words: String,
}

impl Key {
    pub(super) fn line(paint: Paint, words: &str) -> Self {
        Self { paint, sample: Sample::Line, words: words.to_owned() }
    }

    pub(super) fn area(paint: Paint, words: &str) -> Self {
        Self { paint, sample: Sample::Area, words: words.to_owned() }
    }

    pub(super) fn circle(paint: Paint, words: &str) -> Self {
        Self { paint, sample: Sample::Circle, words: words.to_owned() }
    }

    /// The plans, where there is more than one.
    pub(super) fn of_plans(plans: &[Plan]) -> Vec<Self> {
        let several = plans.iter().enumerate().filter(|_| plans.len() > 1);
        several.map(|(index, plan)| Self::line(paint_of(index), &plan.label())).collect()
    }
}

/// A figure before it is drawn.
pub(super) struct Sheet {
    pub(super) name: &'static str,
    pub(super) title: &'static str,
    pub(super) caption: String,
    pub(super) keys: Vec<Key>,
    /// Sentences above the panels.
    pub(super) notes: Vec<String>,
    pub(super) rows: Vec<Vec<Panel>>,
    /// Whether the panels of each row, or of all rows, have one range up.
    pub(super) shared: Shared,
    /// Whether zero belongs to the range up.
    pub(super) with_zero: bool,
}

/// Which panels have one range up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Shared {
    None,
    Rows,
    First,
    All,
}

impl Sheet {
    /// The figure; its curves are coarser where it would be too large.
    pub(super) fn figure(self) -> Figure {
        let mut figure = self.drawn(TOLERANCE);
        for tolerance in COARSER {
            if figure.svg.len() <= LARGEST_FIGURE {
                break;
            }
            figure = self.drawn(tolerance);
        }
        figure
    }

    fn drawn(&self, tolerance: f64) -> Figure {
        let (mut svg, mut maps) = (Svg::default(), Vec::new());
        svg.text([LEFT, 24.0], Anchor::Start, 15.0, self.title);
        let mut top = draw_keys(&self.keys, 44.0, &mut svg);
        for line in self.notes.iter().flat_map(|note| wrapped(note, 98)) {
            svg.text([LEFT, top], Anchor::Start, 12.0, &line);
            top += LINE;
        }
        top -= LINE - 6.0;
        let all = self.rows.iter().flatten().map(|panel| panel.range(1)).fold(None, joined);
        for (index, row) in self.rows.iter().enumerate() {
            let of_row = row.iter().map(|panel| panel.range(1)).fold(None, joined);
            let width = (WIDTH - RIGHT) / row.len() as f64;
            for (column, panel) in row.iter().enumerate() {
                let shared = match self.shared {
                    Shared::All => all,
                    Shared::Rows => of_row,
                    Shared::First if index == 0 => of_row,
                    Shared::None | Shared::First => panel.range(1),
                };
                let with_room = |room: f64| {
                    let (left, right) = (width * column as f64 + room, width * (column + 1) as f64);
                    let px = [[left, right], [top + ABOVE + panel.height, top + ABOVE]];
                    let mut frame = if panel.equal { of_one_scale(panel, px) } else { self.over(panel, shared, px) };
                    if panel.up_falls {
                        frame.data[1].reverse();
                    }
                    frame
                };
                let frame = with_room(with_room(LEFT).room_of_labels(panel).max(LEFT));
                maps.push(frame.draw(panel, tolerance, &mut svg));
            }
            let height = row.iter().map(|panel| panel.height).fold(0.0, f64::max);
            top += ABOVE + height + BELOW;
        }
        let size = [WIDTH, top + 4.0];
        let Self { name, title, caption, .. } = self;
        let svg = svg.document(size[0], size[1], &format!("{title}. {caption}"));
        Figure { name, title, caption: caption.clone(), size, svg, maps }
    }

    /// Time fills the width; all else has free space around.
    fn over(&self, panel: &Panel, up: Range, px: [[f64; 2]; 2]) -> Frame {
        let across = panel.range(0);
        let across = match across {
            Some([low, high]) if panel.across.field == "time_s" && high > low => [low, high],
            _ => padded(across, false),
        };
        Frame { px, data: [across, padded(up, self.with_zero)] }
    }
}

/// The frame of a panel with one scale, as large as fits the width and the height; the smaller range is widened.
fn of_one_scale(panel: &Panel, [[left, right], [lower, upper]]: [[f64; 2]; 2]) -> Frame {
    let ranges = [0, 1].map(|axis| padded(panel.range(axis), false));
    let spans = ranges.map(|[low, high]| high - low);
    let scale = ((right - left) / spans[0]).min((lower - upper) / spans[1]);
    let widened = |axis: usize, px: f64| {
        let middle = f64::midpoint(ranges[axis][0], ranges[axis][1]);
        [middle - 0.5 * px / scale, middle + 0.5 * px / scale]
    };
    Frame { px: [[left, right], [lower, upper]], data: [widened(0, right - left), widened(1, lower - upper)] }
}

/// Draws the legend; gives where the next line of text is.
fn draw_keys(keys: &[Key], top: f64, svg: &mut Svg) -> f64 {
    let (mut x, mut y) = (LEFT, top);
    for Key { paint, sample, words } in keys {
        // Letters are about half as wide as high.
        let width = 32.0 + 5.9 * words.chars().count() as f64 + 14.0;
        if x > LEFT && x + width > WIDTH {
            (x, y) = (LEFT, y + LINE);
        }
        match sample {
            Sample::Line => svg.line([x, y - 4.0], [x + 26.0, y - 4.0], paint),
            Sample::Area => svg.rectangle([x, y - 9.0], [x + 26.0, y + 1.0], paint),
            Sample::Circle => svg.circle([x + 13.0, y - 4.0], 4.0, paint),
        }
        svg.text([x + 32.0, y], Anchor::Start, 12.0, words);
        x += width;
    }
    if keys.is_empty() { y } else { y + LINE }
}

/// The words in lines of about so many letters.
pub(super) fn wrapped(words: &str, letters: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in words.split_whitespace() {
        let line =
            lines.last_mut().filter(|line| line.is_empty() || line.chars().count() + word.chars().count() < letters);
        match line {
            Some(line) if line.is_empty() => line.push_str(word),
            Some(line) => {
                line.push(' ');
                line.push_str(word);
            }
            None => lines.push(word.to_owned()),
        }
    }
    lines
}
