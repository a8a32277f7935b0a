//! Upper bounds over time as convex lines of straight pieces: what has built up may build up faster.

/// A line over time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Line {
    /// Value at time 0.
    pub(super) start: f64,
    /// Change per second.
    pub(super) slope: f64,
}

impl Line {
    /// A line far above all others; finite, so that areas stay numbers.
    pub(super) const ABOVE_ALL: Self = Self { start: 1e150, slope: 0.0 };

    pub(super) fn at(&self, time: f64) -> f64 {
        self.start + self.slope * time
    }
}

/// A straight piece that holds until a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Segment {
    pub(super) to: f64,
    pub(super) line: Line,
}

/// A rate of growth that holds until a time, or up to a value; the last one of several has no end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Level {
    pub(super) until: f64,
    pub(super) rate: f64,
}

/// An upper bound over a span of time.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Curve {
    segments: Vec<Segment>,
}

impl Curve {
    /// No bound at all.
    pub(super) fn above_all(duration: f64) -> Self {
        Self { segments: vec![Segment { to: duration, line: Line::ABOVE_ALL }] }
    }

    /// Growth from `start` on at one rate.
    pub(super) fn straight(start: f64, slope: f64, duration: f64) -> Self {
        Self { segments: vec![Segment { to: duration, line: Line { start, slope } }] }
    }

    /// Growth from `start` on at rates that rise with time; each rate holds from `advance` earlier on.
    pub(super) fn by_time(levels: &[Level], start: f64, advance: f64, duration: f64) -> Self {
        let (mut time, mut value) = (0.0, start);
        let mut segments = Vec::with_capacity(levels.len());
        for level in levels.iter().filter(|level| level.until > advance) {
            let to = (level.until - advance).min(duration);
            segments.push(Segment { to, line: Line { start: value - level.rate * time, slope: level.rate } });
            if to >= duration {
                break;
            }
            (time, value) = (to, value + level.rate * (to - time));
        }
        Self { segments }
    }

    /// Growth from `start` on at rates that rise with the value.
    pub(super) fn by_value(levels: &[Level], start: f64, duration: f64) -> Self {
        let (mut time, mut value) = (0.0, start);
        let mut segments = Vec::with_capacity(levels.len());
        for level in levels.iter().filter(|level| level.until > start) {
            let slope = level.rate;
            let reached = if slope > 0.0 { time + (level.until - value) / slope } else { f64::INFINITY };
            segments.push(Segment { to: reached.min(duration), line: Line { start: value - slope * time, slope } });
            if reached >= duration {
                break;
            }
            (time, value) = (reached, level.until);
        }
        Self { segments }
    }

    /// The same curve in other units.
    pub(super) fn scaled(&self, scale: f64) -> Self {
        let scaled = |line: Line| Line { start: scale * line.start, slope: scale * line.slope };
        let segments = self.segments.iter().map(|segment| Segment { line: scaled(segment.line), ..*segment });
        Self { segments: segments.collect() }
    }

    /// The same curve against time that is left.
    pub(super) fn reversed(&self) -> Self {
        let duration = self.segments.last().map_or(0.0, |last| last.to);
        let froms = std::iter::once(0.0).chain(self.segments.iter().map(|segment| segment.to));
        let reversed = |line: Line| Line { start: line.at(duration), slope: -line.slope };
        let pairs: Vec<_> = self.segments.iter().zip(froms).collect();
        let segment = |(segment, from): (&Segment, f64)| Segment { to: duration - from, line: reversed(segment.line) };
        Self { segments: pairs.into_iter().rev().map(segment).collect() }
    }

    pub(super) fn segments(&self) -> &[Segment] {
        &self.segments
    }

    /// Value at the start of the span.
    pub(super) fn at_start(&self) -> f64 {
        self.segments.first().map_or(0.0, |first| first.line.start)
    }

    /// Value at the end of the span.
    pub(super) fn end(&self) -> f64 {
        self.segments.last().map_or(0.0, |last| last.line.at(last.to))
    }

    /// How much the slope rises over the span.
    pub(super) fn slope_rise(&self) -> f64 {
        let slope = |segment: Option<&Segment>| segment.map_or(0.0, |segment| segment.line.slope);
        slope(self.segments.last()) - slope(self.segments.first())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LEVELS: [Level; 2] = [Level { until: 2.0, rate: 1.0 }, Level { until: f64::INFINITY, rate: 3.0 }];

    fn ends(curve: &Curve) -> Vec<(f64, f64)> {
        curve.segments().iter().map(|segment| (segment.to, segment.line.at(segment.to))).collect()
    }

    #[test]
    fn each_level_has_its_rate() {
        let curve = Curve::by_value(&LEVELS, 1.0, 4.0);
        assert_eq!(ends(&curve), [(1.0, 2.0), (4.0, 11.0)]);
        assert_eq!((curve.end(), curve.slope_rise()), (11.0, 2.0));
        assert_eq!(curve.scaled(0.5).end(), 5.5);
        assert_eq!(ends(&Curve::by_time(&LEVELS, 1.0, 0.5, 4.0)), [(1.5, 2.5), (4.0, 10.0)]);
    }

    #[test]
    fn levels_below_the_start_do_not_count() {
        assert_eq!(Curve::by_value(&LEVELS, 5.0, 1.0).end(), 8.0);
    }

    #[test]
    fn a_reversed_curve_falls_to_its_start() {
        let curve = Curve::by_value(&LEVELS, 1.0, 4.0).reversed();
        assert_eq!(ends(&curve), [(3.0, 2.0), (4.0, 1.0)]);
        assert_eq!(curve.segments()[0].line.at(0.0), 11.0);
    }
}
