//! Plots as SVG: points and lines on log or linear axes, and stacked bars. Text and axes take the colour of the page,
//! so they are readable on light and dark backgrounds.

use std::fmt::Write;

const WIDTH: f64 = 560.0;
const HEIGHT: f64 = 330.0;
/// Left, right, top, bottom of the drawing area.
const AREA: [f64; 4] = [62.0, WIDTH - 14.0, 30.0, HEIGHT - 42.0];
const LEGEND_LINE: f64 = 17.0;
/// Mean width of a letter.
const LETTER: f64 = 7.0;

/// An axis.
#[derive(Clone, Debug, Default)]
pub(crate) struct Axis {
    pub label: String,
    /// Logarithmic if true, else linear.
    pub is_log: bool,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) enum Marker {
    #[default]
    Dot,
    Hollow,
    Square,
    Diamond,
    /// Only the line, no markers.
    Bare,
}

#[derive(Clone, Debug, Default)]
pub(crate) struct Point {
    pub x: f64,
    pub y: f64,
    /// Smallest and largest x of repeated measurements.
    pub spread: Option<[f64; 2]>,
    /// Shown when the pointer rests on the point.
    pub title: String,
    /// Written beside the point.
    pub label: String,
    /// Whether the point gets a ring.
    pub on_front: bool,
}

#[derive(Clone, Debug, Default)]
pub(crate) struct Series {
    pub name: String,
    pub colour: &'static str,
    pub marker: Marker,
    /// Dashes of the line that joins the points, if there is one.
    pub line: Option<&'static str>,
    pub points: Vec<Point>,
}

#[derive(Clone, Debug, Default)]
pub(crate) struct Plot {
    pub title: String,
    pub x: Axis,
    pub y: Axis,
    pub series: Vec<Series>,
}

/// Escapes text for markup.
pub(crate) fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// A number with few digits.
pub(crate) fn short(value: f64) -> String {
    let size = value.abs();
    match () {
        () if value == 0.0 => "0".into(),
        () if !(1e-4..1e9).contains(&size) => format!("{value:.0e}"),
        () if size >= 1e6 => format!("{} M", trimmed(value / 1e6)),
        () if size >= 1e3 => format!("{} k", trimmed(value / 1e3)),
        () => trimmed(value),
    }
}

fn trimmed(value: f64) -> String {
    let digits = (2 - value.abs().max(1e-300).log10().floor() as i32).clamp(0, 6) as usize;
    let text = format!("{value:.digits$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// Maps values to positions along an axis.
struct Scale {
    low: f64,
    high: f64,
    is_log: bool,
    from: f64,
    to: f64,
}

impl Scale {
    fn new(values: impl Iterator<Item = f64>, is_log: bool, from: f64, to: f64) -> Self {
        let map = |v: f64| if is_log { v.log10() } else { v };
        let usable = values.filter(|v| v.is_finite() && (!is_log || *v > 0.0)).map(map);
        let (low, high) = usable.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        let (low, high) = if low <= high { (low, high) } else { (0.0, 1.0) };
        let margin = ((high - low) * 0.06).max(if is_log { 0.05 } else { high.abs() * 0.02 }).max(1e-12);
        Self { low: low - margin, high: high + margin, is_log, from, to }
    }

    fn position(&self, value: f64) -> Option<f64> {
        let value = match self.is_log {
            true if value <= 0.0 => return None,
            true => value.log10(),
            false => value,
        };
        value.is_finite().then(|| self.from + (value - self.low) / (self.high - self.low) * (self.to - self.from))
    }

    /// Values that get a line, and whether they are labelled too.
    fn ticks(&self) -> Vec<(f64, bool)> {
        let span = self.high - self.low;
        let mut ticks = vec![];
        if self.is_log {
            let named: &[f64] = match span {
                s if s < 0.7 => &[1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0],
                s if s < 3.2 => &[1.0, 2.0, 5.0],
                _ => &[1.0],
            };
            for decade in self.low.floor() as i32..=self.high.ceil() as i32 {
                for digit in [1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0] {
                    let is_named = named.contains(&digit);
                    if is_named || digit.fract() == 0.0 {
                        ticks.push((digit * 10f64.powi(decade), is_named));
                    }
                }
            }
        } else {
            let rough = span / 6.0;
            let power = 10f64.powf(rough.log10().floor());
            let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|s| s * power).find(|s| *s >= rough).unwrap_or(rough);
            let first = (self.low / step).ceil() as i64;
            // Adding steps up would accumulate rounding.
            ticks.extend((first..first + 20).map(|k| (k as f64 * step, true)));
        }
        let inside = |v: f64| {
            let v = if self.is_log { v.log10() } else { v };
            v >= self.low - 1e-9 && v <= self.high + 1e-9
        };
        ticks.retain(|(value, _)| inside(*value));
        ticks
    }
}

impl Plot {
    pub fn svg(&self) -> String {
        let [left, right, top, bottom] = AREA;
        let points = || self.series.iter().flat_map(|series| &series.points);
        let xs = points().flat_map(|p| [p.x].into_iter().chain(p.spread.into_iter().flatten()));
        let x = Scale::new(xs, self.x.is_log, left, right);
        let y = Scale::new(points().map(|p| p.y), self.y.is_log, bottom, top);
        let mut body = String::new();
        for (value, is_named) in x.ticks() {
            let Some(at) = x.position(value) else { continue };
            grid(&mut body, [at, top, at, bottom], is_named);
            if is_named {
                text(&mut body, [at, bottom + 15.0], "middle", &short(value), "");
            }
        }
        for (value, is_named) in y.ticks() {
            let Some(at) = y.position(value) else { continue };
            grid(&mut body, [left, at, right, at], is_named);
            if is_named {
                text(&mut body, [left - 6.0, at + 4.0], "end", &short(value), "");
            }
        }
        text(&mut body, [(left + right) / 2.0, bottom + 34.0], "middle", &self.x.label, "");
        let turned = format!(" transform=\"rotate(-90 14 {:.0})\"", (top + bottom) / 2.0);
        text(&mut body, [14.0, (top + bottom) / 2.0], "middle", &self.y.label, &turned);
        // Labels must not overlap; the first one stays.
        let mut labels: Vec<[f64; 2]> = vec![];
        for series in &self.series {
            draw_series(&mut body, series, &x, &y, &mut labels);
        }
        let entries = self.series.iter().filter(|series| !series.name.is_empty()).collect::<Vec<_>>();
        let height = legend(&mut body, &entries, HEIGHT + 4.0);
        svg_document(&self.title, height, &body)
    }
}

fn draw_series(body: &mut String, series: &Series, x: &Scale, y: &Scale, labels: &mut Vec<[f64; 2]>) {
    let colour = series.colour;
    let placed = |p: &Point| Some([x.position(p.x)?, y.position(p.y)?]);
    if let Some(dashes) = series.line {
        let path: Vec<String> =
            series.points.iter().filter_map(placed).map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
        let _ = writeln!(
            body,
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.5\" stroke-dasharray=\"{dashes}\"/>",
            path.join(" ")
        );
    }
    for point in &series.points {
        let Some([px, py]) = placed(point) else { continue };
        if let Some([Some(from), Some(to)]) = point.spread.map(|spread| spread.map(|v| x.position(v))) {
            let _ =
                writeln!(body, "<path d=\"M{from:.1} {py:.1}H{to:.1}\" stroke=\"{colour}\" stroke-opacity=\"0.6\"/>");
        }
        if point.on_front {
            let _ = writeln!(
                body,
                "<circle cx=\"{px:.1}\" cy=\"{py:.1}\" r=\"7.5\" fill=\"none\" stroke=\"currentColor\"/>"
            );
        }
        let title =
            if point.title.is_empty() { String::new() } else { format!("<title>{}</title>", escape(&point.title)) };
        marker(body, series, [px, py], &title);
        if !point.label.is_empty() && !labels.iter().any(|l| (l[0] - px).abs() < 90.0 && (l[1] - py).abs() < 12.0) {
            labels.push([px, py]);
            let room_right = px + 10.0 + point.label.len() as f64 * LETTER < AREA[1];
            let (at, anchor) = if room_right { (px + 10.0, "start") } else { (px - 10.0, "end") };
            text(body, [at, py - 5.0], anchor, &point.label, "");
        }
    }
}

fn marker(body: &mut String, series: &Series, [x, y]: [f64; 2], title: &str) {
    let colour = series.colour;
    let _ = match series.marker {
        Marker::Bare => Ok(()),
        Marker::Dot => writeln!(body, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4\" fill=\"{colour}\">{title}</circle>"),
        Marker::Hollow => writeln!(
            body,
            "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3.5\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.6\">{title}</circle>"
        ),
        Marker::Square => {
            let (x, y) = (x - 3.5, y - 3.5);
            writeln!(body, "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"7\" height=\"7\" fill=\"{colour}\">{title}</rect>")
        }
        Marker::Diamond => {
            writeln!(body, "<path d=\"M{x:.1} {:.1}l5 5l-5 5l-5 -5z\" fill=\"{colour}\">{title}</path>", y - 5.0)
        }
    };
}

fn text(body: &mut String, [x, y]: [f64; 2], anchor: &str, text: &str, extra: &str) {
    let text = escape(text);
    let _ = writeln!(body, "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\"{extra}>{text}</text>");
}

fn grid(body: &mut String, [x1, y1, x2, y2]: [f64; 4], is_named: bool) {
    let opacity = if is_named { 0.22 } else { 0.08 };
    let _ = writeln!(
        body,
        "<path d=\"M{x1:.1} {y1:.1}L{x2:.1} {y2:.1}\" stroke=\"currentColor\" stroke-opacity=\"{opacity}\"/>"
    );
}

/// Draws the names of series below the plot. Returns where they end.
fn legend(body: &mut String, entries: &[&Series], top: f64) -> f64 {
    let (mut x, mut y) = (AREA[0] - 40.0, top + 4.0);
    for series in entries {
        let width = 34.0 + series.name.chars().count() as f64 * LETTER;
        if x + width > WIDTH {
            (x, y) = (AREA[0] - 40.0, y + LEGEND_LINE);
        }
        if let Some(dashes) = series.line {
            let colour = series.colour;
            let _ = writeln!(
                body,
                "<path d=\"M{x:.1} {y:.1}h22\" stroke=\"{colour}\" stroke-width=\"1.5\" stroke-dasharray=\"{dashes}\"/>"
            );
        }
        marker(body, series, [x + 11.0, y], "");
        text(body, [x + 27.0, y + 4.0], "start", &series.name, "");
        x += width + 8.0;
    }
    y + LEGEND_LINE
}

fn svg_document(title: &str, height: f64, body: &str) -> String {
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height:.0}\" role=\"img\" font-family=\"sans-serif\" \
         font-size=\"12\" fill=\"currentColor\" stroke-linecap=\"round\">\n<title>{0}</title>\n\
         <text x=\"{WIDTH_HALF:.0}\" y=\"18\" text-anchor=\"middle\" font-size=\"14\" font-weight=\"bold\">{0}</text>\n{body}</svg>\n",
        escape(title)
    )
}

const WIDTH_HALF: f64 = WIDTH / 2.0;

/// Colours that most people can tell apart, on light and dark.
pub(crate) const COLOURS: [&str; 10] =
    ["#1f83c9", "#d9730d", "#2a9d5c", "#c8443f", "#8d6bc0", "#946150", "#d16ba5", "#808080", "#a3a01c", "#17a2ad"];

/// Stacked bars: one bar per row, its parts side by side, with the sum written after it.
pub(crate) fn bars(title: &str, unit: &str, parts: &[&str], rows: &[(String, Vec<f64>)]) -> String {
    const BAR: f64 = 24.0;
    let left = rows.iter().map(|(name, _)| name.chars().count()).max().unwrap_or(0) as f64 * LETTER + 12.0;
    let most = rows.iter().map(|(_, values)| values.iter().sum::<f64>()).fold(1e-12, f64::max);
    let mut body = String::new();
    for (k, (name, values)) in rows.iter().enumerate() {
        let y = 34.0 + k as f64 * BAR;
        text(&mut body, [left - 6.0, y + 13.0], "end", name, "");
        let mut x = left;
        for (part, (value, colour)) in parts.iter().zip(values.iter().zip(COLOURS.iter().cycle())) {
            let width = value / most * (WIDTH - left - 70.0);
            let _ = writeln!(
                body,
                "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{width:.1}\" height=\"{:.0}\" fill=\"{colour}\"><title>{}: {} {}</title></rect>",
                BAR - 6.0,
                escape(part),
                short(*value),
                escape(unit)
            );
            x += width;
        }
        text(&mut body, [x + 6.0, y + 13.0], "start", &format!("{} {unit}", short(values.iter().sum())), "");
    }
    let series: Vec<Series> = parts
        .iter()
        .zip(COLOURS.iter().cycle())
        .map(|(part, &colour)| Series { name: part.to_string(), colour, marker: Marker::Square, ..Series::default() })
        .collect();
    let height = legend(&mut body, &series.iter().collect::<Vec<_>>(), 38.0 + rows.len() as f64 * BAR);
    svg_document(title, height, &body)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_outside_the_domain_of_a_log_axis_are_left_out() {
        let points = [0.0, 1.0, f64::NAN, 100.0].map(|x| Point { x, y: 1.0, title: "a<b".into(), ..Point::default() });
        let series = Series { name: "s".into(), colour: COLOURS[0], points: points.into(), ..Series::default() };
        let axis = || Axis { label: "x & y".into(), is_log: true };
        let svg = Plot { title: "t".into(), x: axis(), y: axis(), series: vec![series] }.svg();
        // Two points, and those of the legend.
        assert_eq!(svg.matches("<circle").count(), 3);
        assert!(!svg.contains("NaN") && !svg.contains("inf") && svg.contains("a&lt;b") && svg.contains("x &amp; y"));
        assert!(!Plot::default().svg().contains("NaN"));
    }

    #[test]
    fn numbers_are_short() {
        let all = [0.0, 0.05, 1.25, 20.0, 1500.0, 871_414.0, 2.5e6, 1e-7].map(short);
        assert_eq!(all, ["0", "0.05", "1.25", "20", "1.5 k", "871 k", "2.5 M", "1e-7"]);
    }
}
