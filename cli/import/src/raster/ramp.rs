//! Colours by height: some by name, others from a file.

use std::path::Path;
use std::str::FromStr;

use lodpack::heights::{Ramp as RampOfHeights, RampStop};
use serde::{Deserialize, Serialize};

/// No file of colours is larger.
const MOST_FILE_BYTES: u64 = 1 << 20;

/// Where a colour is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
enum At {
    /// In metres.
    Metres(f64),
    /// In the unit of the heights.
    Height(f64),
    /// From 0 at the lowest to 1 at the highest height.
    Share(f64),
}

/// Colours by height.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Ramp {
    /// That of a known ramp, or of the file.
    pub name: String,
    stops: Vec<(At, [u8; 3])>,
}

const EARTH: [(f64, [u8; 3]); 11] = [
    (-8000.0, [8, 20, 70]),
    (-4000.0, [20, 60, 130]),
    (-200.0, [90, 160, 210]),
    (-0.001, [170, 215, 235]),
    (0.0, [70, 130, 75]),
    (250.0, [130, 170, 95]),
    (800.0, [215, 205, 140]),
    (1800.0, [175, 130, 85]),
    (3000.0, [135, 100, 80]),
    (4200.0, [205, 200, 200]),
    (5500.0, [255, 255, 255]),
];
const GREY: [(f64, [u8; 3]); 2] = [(0.0, [0, 0, 0]), (1.0, [255, 255, 255])];
const VIRIDIS: [(f64, [u8; 3]); 6] = [
    (0.0, [68, 1, 84]),
    (0.2, [65, 68, 135]),
    (0.4, [42, 120, 142]),
    (0.6, [34, 168, 132]),
    (0.8, [122, 209, 81]),
    (1.0, [253, 231, 37]),
];

impl Ramp {
    /// The known ramps: earth is blue, green, brown and white, with the shore at height 0; grey goes from black at the
    /// lowest to white at the highest height; viridis from violet to yellow, even in lightness.
    pub const NAMES: [&str; 3] = ["earth", "grey", "viridis"];

    /// A known ramp.
    pub fn named(name: &str) -> Option<Self> {
        let of =
            |stops: &[(f64, [u8; 3])], at: fn(f64) -> At| stops.iter().map(|&(x, colour)| (at(x), colour)).collect();
        let stops = match name {
            "earth" => of(&EARTH, At::Metres),
            "grey" => of(&GREY, At::Share),
            "viridis" => of(&VIRIDIS, At::Share),
            _ => return None,
        };
        Some(Self { name: name.to_owned(), stops })
    }

    /// A ramp from a file of colours as `gdaldem color-relief` takes it: lines of a height, or a share of the range as
    /// 25%, and of red, green and blue from 0 to 255.
    ///
    /// # Errors
    /// What is wrong with the file, and where.
    pub fn read(path: &Path) -> Result<Self, String> {
        let unreadable = |error: std::io::Error| {
            let names = Self::NAMES.join(", ");
            format!("'{}' is none of {names}, and no file of colours that can be read: {error}", path.display())
        };
        let size = std::fs::metadata(path).map_err(unreadable)?.len();
        if size > MOST_FILE_BYTES {
            return Err(format!("{}: has {size} bytes, which no file of colours has", path.display()));
        }
        let text = std::fs::read(path).map_err(unreadable)?;
        let text = String::from_utf8_lossy(&text);
        let mut stops = vec![];
        for (number, line) in (1..).zip(text.lines()) {
            let line = line.split('#').next().unwrap_or_default();
            let words: Vec<&str> = line.split([' ', '\t', ',', ':', ';']).filter(|word| !word.is_empty()).collect();
            let Some(first) = words.first() else { continue };
            if first.eq_ignore_ascii_case("nv") {
                continue;
            }
            let stop = stop(&words).ok_or_else(|| {
                format!(
                    "{}: line {number}: write a height and red, green and blue from 0 to 255, as '1200 135 100 80' or '25% 65 68 135'",
                    path.display()
                )
            })?;
            stops.push(stop);
        }
        let name = path.file_stem().unwrap_or_default().to_string_lossy().chars().take(60).collect();
        let ramp = Self { name, stops };
        ramp.over([0.0, 1.0], None).map_err(|error| format!("{}: {error}", path.display()))?;
        Ok(ramp)
    }

    /// Whether the heights have to be known first.
    pub fn needs_range(&self) -> bool {
        self.stops.iter().any(|(at, _)| matches!(at, At::Share(_)))
    }

    /// The ramp of heights between the lowest and the highest one; `metres` are in a unit of heights, where that is
    /// known.
    ///
    /// # Errors
    /// [`lodpack::Error::Model`] if it has no stops or too many, or heights that are not finite.
    pub fn over(&self, [low, high]: [f64; 2], metres: Option<f64>) -> lodpack::Result<RampOfHeights> {
        // A flat surface has the colour in the middle.
        let [low, high] = if high > low { [low, high] } else { [low - 0.5, low + 0.5] };
        let height = |at: At| match at {
            At::Metres(at) => at / metres.unwrap_or(1.0),
            At::Height(at) => at,
            At::Share(share) => low + share * (high - low),
        };
        let stops = self.stops.iter().map(|&(at, colour)| RampStop { height: height(at), colour });
        let mut stops: Vec<RampStop> = stops.collect();
        stops.sort_by(|a, b| a.height.total_cmp(&b.height));
        RampOfHeights::new(stops)
    }
}

fn stop(words: &[&str]) -> Option<(At, [u8; 3])> {
    // An opacity may follow, which a surface does not have.
    let ([first, red, green, blue] | [first, red, green, blue, _]) = words else { return None };
    let at = match first.strip_suffix('%') {
        Some(percent) => At::Share(percent.parse::<f64>().ok()? / 100.0),
        None => At::Height(first.parse().ok()?),
    };
    let byte = |word: &str| word.parse::<f64>().ok().filter(|x| (0.0..=255.0).contains(x)).map(|x| x.round() as u8);
    Some((at, [byte(red)?, byte(green)?, byte(blue)?]))
}

impl FromStr for Ramp {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Self::named(text).map_or_else(|| Self::read(Path::new(text)), Ok)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Ramp, String> {
        let file = tempfile::Builder::new().prefix("hills").suffix(".txt").tempfile().expect("a temporary file");
        std::fs::write(file.path(), text).expect("writable");
        Ramp::read(file.path())
    }

    #[test]
    fn files_of_colours_are_read_and_mistakes_named() {
        let ramp = read("# hills\n1000, 200 100 50\n\n0 0 100 0 255\nnv 1 2 3\n100%:255:255:255\n").expect("sound");
        assert!(ramp.needs_range() && ramp.name.starts_with("hills"));
        let ramp = ramp.over([-10.0, 2000.0], None).expect("sound");
        let heights: Vec<f64> = ramp.stops().iter().map(|stop| stop.height).collect();
        assert_eq!(heights, [0.0, 1000.0, 2000.0]);
        assert_eq!(ramp.colour(500.0), [100, 100, 25]);
        for (text, place) in
            [("0 1 2\n", "line 1"), ("0 0 0 0\nx 1 2 3\n", "line 2"), ("0 1 2 256\n", "line 1"), ("#\n", "1 to 1,024")]
        {
            let error = read(text).expect_err(text);
            assert!(error.contains(place), "{text}: {error}");
        }
        assert!("eath".parse::<Ramp>().expect_err("no file").contains("earth, grey, viridis"));
    }

    #[test]
    fn known_ramps_fit_any_range_and_unit() {
        for name in Ramp::NAMES {
            let ramp = name.parse::<Ramp>().expect("known");
            for range in [[0.0, 0.0], [-5.0, 7.0]] {
                assert!(ramp.over(range, Some(0.3048)).is_ok());
            }
        }
        let earth = Ramp::named("earth").expect("known").over([0.0, 1.0], Some(0.3048)).expect("sound");
        assert_eq!(earth.stops().last().map(|stop| stop.height), Some(5500.0 / 0.3048));
    }
}
