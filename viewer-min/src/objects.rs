//! Objects of a mesh: found by the command line, picked in the window, hidden and shown alone.

use anyhow::{Context, Result, bail};
use lodpack::{
    File, ReadAt, View,
    index::Ray,
    objects::{ObjectChoice, ObjectNode},
};

use crate::args::Args;

/// What is drawn of the objects of a file, and which one is selected.
#[derive(Clone, Debug, Default)]
pub(crate) struct ShownObjects {
    pub choice: ObjectChoice,
    pub selected: Option<Selected>,
}

/// An object or assembly that was picked or found.
#[derive(Clone, Debug)]
pub(crate) struct Selected {
    pub number: u32,
    /// All that it is in, its own name, and its id.
    pub text: String,
}

/// What a node is called.
fn title(number: u32, node: &ObjectNode) -> String {
    let name = node.name.as_ref().or(node.id.as_ref()).filter(|name| !name.is_empty());
    name.cloned().unwrap_or_else(|| format!("#{number}"))
}

impl Selected {
    pub fn new<S: ReadAt>(file: &File<S>, number: u32) -> Result<Self> {
        let objects = file.objects().context("this file has no objects")?;
        let node = objects.node(number)?;
        let mut path = vec![];
        for above in objects.above(number)? {
            path.push(title(above, &objects.node(above)?));
        }
        path.reverse();
        path.push(title(number, &node));
        let id = node.id.filter(|id| path.last() != Some(id)).map(|id| format!("  ({id})"));
        Ok(Self { number, text: path.join(" / ") + &id.unwrap_or_default() })
    }
}

/// The nodes of a name, or of an id if none has that name, or the one of a number (#12).
pub(crate) fn find<S: ReadAt>(file: &File<S>, text: &str) -> Result<Vec<u32>> {
    let objects = file.objects().context("this file has no objects; build it with --objects keep")?;
    let mut found = objects.find_name(text)?;
    if found.is_empty() {
        found = objects.find_id(text)?;
    }
    let number = text.strip_prefix('#').and_then(|number| number.parse().ok());
    found.extend(number.filter(|&number: &u32| number < objects.node_count()));
    if found.is_empty() {
        bail!("no object has the name or id {text}; `lodpack info --objects` lists them");
    }
    Ok(found)
}

impl ShownObjects {
    /// What the command line asks for.
    pub fn of_args<S: ReadAt>(file: &File<S>, args: &Args) -> Result<Self> {
        let all = |texts: &[String]| -> Result<Vec<u32>> {
            let found = texts.iter().map(|text| find(file, text)).collect::<Result<Vec<_>>>()?;
            Ok(found.concat())
        };
        let only = (!args.only.is_empty()).then(|| all(&args.only)).transpose()?;
        let choice = ObjectChoice { only, hidden: all(&args.hide)?, ..ObjectChoice::default() };
        let found = args.find.as_ref().map(|text| find(file, text)).transpose()?;
        let selected = found.and_then(|found| found.first().copied());
        Ok(Self { choice, selected: selected.map(|number| Selected::new(file, number)).transpose()? })
    }

    /// Carries out what a key asks of what is selected: h hides it, i shows it alone, j shows everything again. Returns
    /// whether something else is drawn then.
    pub fn obey(&mut self, letter: &str) -> bool {
        match (letter, self.selected.as_ref().map(|selected| selected.number)) {
            ("j", _) => self.choice = ObjectChoice::default(),
            ("h", Some(number)) => {
                self.choice.hidden.push(number);
                self.selected = None;
            }
            ("i", Some(number)) => {
                self.choice.hidden.retain(|&other| other != number);
                self.choice.only = Some(vec![number]);
            }
            _ => return false,
        }
        true
    }
}

/// The ray of a place in a picture: 0 to 1 from the upper left corner.
pub(crate) fn ray_at(view: &View, [x, y]: [f64; 2]) -> Ray {
    let [right, up, forward] = view.axes();
    let tangent = (view.vertical_fov / 2.0).tan();
    let [width, height] = view.viewport.map(|pixels| f64::from(pixels.max(1)));
    let [across, along] = [(2.0 * x - 1.0) * tangent * width / height, (1.0 - 2.0 * y) * tangent];
    Ray { origin: view.position, direction: [0, 1, 2].map(|k| forward[k] + right[k] * across + up[k] * along) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_go_to_where_the_picture_shows() {
        let view = View {
            position: [1.0, 2.0, 3.0],
            forward: [0.0, 0.0, -2.0],
            up: [0.0, 3.0, 0.0],
            viewport: [200, 100],
            vertical_fov: std::f64::consts::FRAC_PI_2,
            ..View::default()
        };
        let near = |ray: Ray, wanted: [f64; 3]| {
            assert_eq!(ray.origin, view.position);
            assert!((0..3).all(|k| (ray.direction[k] - wanted[k]).abs() < 1e-12), "{ray:?} {wanted:?}");
        };
        near(ray_at(&view, [0.5, 0.5]), [0.0, 0.0, -1.0]);
        near(ray_at(&view, [1.0, 0.0]), [2.0, 1.0, -1.0]);
        near(ray_at(&view, [0.0, 1.0]), [-2.0, -1.0, -1.0]);
    }
}
