//! How positions of a file become those of glTF.

use lodpack::index::{Placement, UpAxis};
use serde_json::{Value, json};

/// How positions become glTF's, which has metres and y up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Upright {
    /// Whether z is up.
    pub is_z_up: bool,
    /// The length of a unit, metres.
    pub unit: f64,
}

impl Default for Upright {
    /// As they are.
    fn default() -> Self {
        Self { is_z_up: false, unit: 1.0 }
    }
}

impl Upright {
    /// The axis that points up and the unit, as a file says: z where it only says its CRS, else y.
    pub fn of(placement: Option<&Placement>) -> Self {
        let Some(Placement { up, unit, crs, .. }) = placement else { return Self::default() };
        let is_z_up = match up {
            UpAxis::Z => true,
            UpAxis::Y => false,
            _ => !crs.is_empty(),
        };
        Self { is_z_up, unit: unit.unwrap_or(1.0) }
    }

    /// That of heights, and of what stands on them: z points up, unless the file says that y does.
    pub fn along_z(placement: Option<&Placement>) -> Self {
        let says_y = placement.is_some_and(|placement| placement.up == UpAxis::Y);
        Self { is_z_up: !says_y, ..Self::of(placement) }
    }

    /// A node that shows a mesh of a number, whose positions are relative to a centre.
    pub(super) fn node(self, mesh: usize, centre: [f64; 3]) -> Value {
        let Self { is_z_up, unit } = self;
        let [x, y, z] = centre.map(|c| c * unit);
        let mut node = json!({"mesh": mesh, "translation": if is_z_up { [x, z, -y] } else { [x, y, z] }});
        if is_z_up {
            let half = std::f64::consts::FRAC_1_SQRT_2;
            node["rotation"] = json!([-half, 0.0, 0.0, half]);
        }
        if unit != 1.0 {
            node["scale"] = [unit; 3].into();
        }
        node
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_turn_what_has_z_up_and_become_metres() {
        let upright =
            |up, unit, crs: &str| Upright::of(Some(&Placement { up, unit, crs: crs.into(), ..Placement::default() }));
        assert_eq!(Upright::of(None).node(3, [1.0, 2.0, 3.0]), json!({"mesh": 3, "translation": [1.0, 2.0, 3.0]}));
        assert_eq!(upright(UpAxis::Unknown, None, ""), Upright::default());
        assert_eq!(upright(UpAxis::Y, Some(0.5), "EPSG:32632"), Upright { is_z_up: false, unit: 0.5 });
        assert!(upright(UpAxis::Unknown, None, "EPSG:32632").is_z_up && Upright::along_z(None).is_z_up);
        assert!(!Upright::along_z(Some(&Placement { up: UpAxis::Y, ..Placement::default() })).is_z_up);
        let node = upright(UpAxis::Z, Some(0.5), "").node(0, [1.0, 2.0, 3.0]);
        assert_eq!(node["translation"], json!([0.5, 1.5, -1.0]));
        assert_eq!(node["scale"], json!([0.5, 0.5, 0.5]));
        // A quarter turn around x, which takes z to y.
        let [x, w] = [0, 3].map(|k| node["rotation"][k].as_f64().unwrap());
        let (sin, cos) = (2.0 * x * w, w * w - x * x);
        assert!(cos.abs() < 1e-12 && (sin + 1.0).abs() < 1e-12);
    }
}
