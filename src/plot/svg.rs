//! A writer of SVG: elements with presentation attributes and classes, never `style` or `script`; all text is escaped.

use std::fmt::Write as _;

/// How something is painted. Its class lets the style sheet of a page replace the colours.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Paint {
    class: &'static str,
    stroke: &'static str,
    width: f64,
    dash: &'static str,
    fill: &'static str,
    opacity: f64,
}

impl Paint {
    /// A line.
    pub(super) const fn line(class: &'static str, stroke: &'static str, width: f64) -> Self {
        Self { class, stroke, width, dash: "", fill: "none", opacity: 1.0 }
    }

    /// An area.
    pub(super) const fn area(class: &'static str, fill: &'static str, opacity: f64) -> Self {
        Self { class, stroke: "none", width: 0.0, dash: "", fill, opacity }
    }

    /// Lengths of dashes and gaps, px.
    pub(super) const fn dashed(self, dash: &'static str) -> Self {
        Self { dash, ..self }
    }

    /// Another width of the line.
    pub(super) const fn wide(self, width: f64) -> Self {
        Self { width, ..self }
    }

    /// Less opaque.
    pub(super) const fn faint(self, opacity: f64) -> Self {
        Self { opacity, ..self }
    }

    /// Filled, beside its line.
    pub(super) const fn filled(self, fill: &'static str) -> Self {
        Self { fill, ..self }
    }
}

/// Where a text stands beside its point.
#[derive(Debug, Clone, Copy)]
pub(super) enum Anchor {
    /// It begins there.
    Start,
    /// It is centred there.
    Middle,
    /// It ends there.
    End,
}

/// A document that is being written.
#[derive(Debug, Default)]
pub(super) struct Svg(String);

impl Svg {
    /// The document: `width` by `height` px, with the words for those who do not see it.
    pub(super) fn document(self, width: f64, height: f64, words: &str) -> String {
        let head = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"{}\" \
             font-family=\"Helvetica, Arial, 'Liberation Sans', sans-serif\" font-size=\"12\">",
            number(width),
            number(height),
            escaped(words)
        );
        let ground = format!(
            "<rect class=\"sd-ground\" width=\"{}\" height=\"{}\" fill=\"#ffffff\"/>",
            number(width),
            number(height)
        );
        head + &ground + &self.0 + "</svg>\n"
    }

    /// A rectangle from one corner to the opposite one.
    pub(super) fn rectangle(&mut self, [x, y]: [f64; 2], [to_x, to_y]: [f64; 2], paint: &Paint) {
        let (left, top) = (x.min(to_x), y.min(to_y));
        let corners = [("x", left), ("y", top), ("width", (to_x - x).abs()), ("height", (to_y - y).abs())];
        self.element("rect", &corners, paint, "");
    }

    /// A circle.
    pub(super) fn circle(&mut self, [x, y]: [f64; 2], radius: f64, paint: &Paint) {
        self.element("circle", &[("cx", x), ("cy", y), ("r", radius)], paint, "");
    }

    /// A straight line.
    pub(super) fn line(&mut self, from: [f64; 2], to: [f64; 2], paint: &Paint) {
        self.lines([&[from, to][..]].into_iter(), false, paint);
    }

    /// Lines through points, to a tenth of a pixel; nothing with fewer than two.
    pub(super) fn lines<'a>(&mut self, curves: impl Iterator<Item = &'a [[f64; 2]]>, closed: bool, paint: &Paint) {
        let mut path = String::new();
        for points in curves.filter(|points| points.len() > 1) {
            // Differences of rounded places: nothing adds up.
            let tenths = points.iter().map(|point| point.map(|coordinate| (10.0 * coordinate).round()));
            let mut last = [0.0; 2];
            for (index, place) in tenths.enumerate() {
                let command = ["M", "l", ""][index.min(2)];
                let (x, y) = (number((place[0] - last[0]) / 10.0), number((place[1] - last[1]) / 10.0));
                let before = if index > 1 && !x.starts_with('-') { " " } else { "" };
                let between = if y.starts_with('-') { "" } else { " " };
                // Writing to a string cannot fail.
                let _ = write!(path, "{command}{before}{x}{between}{y}");
                last = place;
            }
            if closed {
                path.push('z');
            }
        }
        if !path.is_empty() {
            self.element("path", &[], paint, &format!(" d=\"{path}\""));
        }
    }

    /// Words at a point.
    pub(super) fn text(&mut self, [x, y]: [f64; 2], anchor: Anchor, size: f64, words: &str) {
        let anchor = match anchor {
            Anchor::Start => "",
            Anchor::Middle => " text-anchor=\"middle\"",
            Anchor::End => " text-anchor=\"end\"",
        };
        let weight = if size > 13.0 { " font-weight=\"bold\"" } else { "" };
        let (x, y, size, words) = (number(x), number(y), number(size), escaped(words));
        let _ = write!(
            self.0,
            "<text class=\"sd-ink\" fill=\"#1a1a1a\" x=\"{x}\" y=\"{y}\" font-size=\"{size}\"{weight}{anchor}>{words}</text>"
        );
    }

    fn element(&mut self, name: &str, places: &[(&str, f64)], paint: &Paint, more: &str) {
        let Paint { class, stroke, width, dash, fill, opacity } = *paint;
        let _ = write!(self.0, "<{name} class=\"{class}\"");
        for (attribute, value) in places {
            let _ = write!(self.0, " {attribute}=\"{}\"", number(*value));
        }
        let _ = write!(self.0, " fill=\"{fill}\"");
        if stroke != "none" {
            let width = number(width);
            let _ = write!(self.0, " stroke=\"{stroke}\" stroke-width=\"{width}\" stroke-linejoin=\"round\"");
        }
        if !dash.is_empty() {
            let _ = write!(self.0, " stroke-dasharray=\"{dash}\"");
        }
        if opacity < 1.0 {
            let _ = write!(self.0, " opacity=\"{}\"", number(opacity));
        }
        let _ = write!(self.0, "{more}/>");
    }
}

/// To two decimals, as short as possible; what is no number is 0.
fn number(value: f64) -> String {
    if !value.is_finite() {
        return "0".to_owned();
    }
    // Adding zero turns -0 into 0.
    let text = ((100.0 * value).round() / 100.0 + 0.0).to_string();
    text.strip_prefix("0.")
        .map(|rest| format!(".{rest}"))
        .or_else(|| text.strip_prefix("-0.").map(|rest| format!("-.{rest}")))
        .unwrap_or(text)
}

/// A text as it may stand between tags and between quotes; control characters, which no document may hold, are left out.
pub fn escaped(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            '\'' => escaped.push_str("&#39;"),
            '\u{fffe}' | '\u{ffff}' => {}
            _ if character.is_control() => escaped.push(' '),
            _ => escaped.push(character),
        }
    }
    escaped
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_and_attributes_are_escaped() {
        let mut svg = Svg::default();
        svg.text([1.0, 2.0], Anchor::End, 12.0, "<img onerror='x'> & \"$(y)\"\u{0}");
        let document = svg.document(10.0, 10.0, "\"><script>");
        assert!(document.contains("&lt;img onerror=&#39;x&#39;&gt; &amp; &quot;$(y)&quot; </text>"), "{document}");
        assert!(document.contains("aria-label=\"&quot;&gt;&lt;script&gt;\""), "{document}");
    }

    #[test]
    fn numbers_are_short_and_never_anything_else() {
        let numbers = [1.0, -0.5, 0.25, 12.345_6, -0.001, f64::NAN, f64::INFINITY];
        assert_eq!(numbers.map(number), ["1", "-.5", ".25", "12.35", "0", "0", "0"]);
    }

    #[test]
    fn lines_are_differences_that_do_not_add_up() {
        let mut svg = Svg::default();
        let points: Vec<_> = (0..1000).map(|index| [f64::from(index) * 0.06, -1.0]).collect();
        svg.lines([&points[..]].into_iter(), false, &Paint::line("c", "#000", 1.0));
        let path = svg.0.split(" d=\"M0-1l").nth(1).unwrap().split('"').next().unwrap().to_owned();
        let end: f64 = path.split_whitespace().map(|number| number.parse::<f64>().unwrap()).sum();
        assert!((end - 59.94).abs() < 0.06, "{end}");
    }
}
