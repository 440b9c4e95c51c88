//! The ground that a surface stands on: a file of heights within a file of a mesh (SPEC.md, "Section GROUND").

#[cfg(feature = "write")]
mod join;

#[cfg(feature = "write")]
pub use join::join_ground;

use crate::{
    error::{Error, Result},
    file::File,
    format::{
        header::kind,
        placement::{Placement, UpAxis},
    },
    heights::{Heights, HeightsIndex},
    index::Index,
    select::View,
    source::{ReadAt, Within},
};

/// Units and origins beyond it are refused, so that all coordinates stay finite.
const LARGEST: f64 = 1e15;

/// The heights of a file's ground, and where they are in the space of its surface.
#[derive(Debug)]
pub struct Ground<S> {
    /// The heights, in coordinates of their own. All that applies to a file of heights applies to them: sessions, cuts,
    /// windows of samples.
    pub heights: Heights<S>,
    /// Takes their coordinates to those of the surface.
    pub frame: GroundFrame,
}

/// Takes coordinates of a ground to those of the surface that stands on it, or those of one file to those of another in
/// the same picture ([`GroundFrame::between`]). Both say where they are in the world in metres with z up, and this
/// compares what they say. It turns, scales and moves; an error of the ground grows by [`GroundFrame::scale`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GroundFrame {
    /// Metres in a unit: of the ground, of the surface.
    units: [f64; 2],
    /// What is added to coordinates in metres: of the ground, of the surface.
    origins: [[f64; 3]; 2],
    /// Whether y is up: in the ground, in the surface.
    is_y_up: [bool; 2],
}

impl<S: ReadAt> Ground<S> {
    /// The ground of a file that has this index. `source` holds the ground alone: the bytes of [`Index::ground_range`].
    ///
    /// # Errors
    /// As [`Heights::open`]; [`Error::Format`] if it holds no heights, if it lies on a globe, or in another coordinate
    /// reference system than the surface.
    pub fn within(index: &Index, source: S) -> Result<Self> {
        let open = || {
            let heights = Heights::open(source, *index.limits()).map_err(|error| match error {
                Error::Query { .. } => Error::format("the ground of a mesh is no file of heights"),
                other => other,
            })?;
            let frame = GroundFrame::under(heights.index(), index.placement())?;
            Ok(Self { heights, frame })
        };
        open().map_err(|error: Error| error.at(|| "section ground".to_string()))
    }
}

impl<S: ReadAt> Ground<Within<S>> {
    /// The ground of a file that has this index and is read from `source`; none if it has none.
    ///
    /// # Errors
    /// As [`Ground::within`].
    pub fn open(index: &Index, source: S) -> Result<Option<Self>> {
        index.ground_range().map(|range| Ground::within(index, Within::new(source, range))).transpose()
    }
}

impl<S: ReadAt> File<S> {
    /// The heights that the surface stands on, if the file has some: one more request of 16 KiB.
    ///
    /// # Errors
    /// As [`Ground::open`].
    pub fn ground(&self) -> Result<Option<Ground<Within<&S>>>> {
        Ground::open(self.index(), self.source())
    }
}

impl Index {
    /// Where the file of the ground's heights lies in the file; none if there is none.
    pub fn ground_range(&self) -> Option<std::ops::Range<u64>> {
        let section = self.header().section(kind::GROUND)?;
        Some(section.offset..section.offset.saturating_add(section.length))
    }
}

impl GroundFrame {
    /// The frame of a ground, which has z up, and a surface with these placements.
    ///
    /// # Errors
    /// [`Error::Format`] if they are in different coordinate reference systems (one that is not said is no other one),
    /// or a unit or an origin is beyond what is measured.
    pub fn new(ground: Option<&Placement>, surface: Option<&Placement>) -> Result<Self> {
        let ground = Placement { up: UpAxis::Z, ..ground.cloned().unwrap_or_default() };
        let [of_ground, of_surface] = [&ground.crs, &surface.cloned().unwrap_or_default().crs];
        if !of_ground.is_empty() && !of_surface.is_empty() && of_ground != of_surface {
            return Err(Error::format("the ground is in another coordinate reference system than the surface on it"));
        }
        Self::between(Some(&ground), surface)
    }

    /// What takes coordinates of a file with the first placement to those of a file with the second one. A file that
    /// does not say what is up has the same up as the other.
    ///
    /// # Errors
    /// As [`GroundFrame::new`].
    pub fn between(file: Option<&Placement>, other: Option<&Placement>) -> Result<Self> {
        let [ground, surface] = [file, other].map(|placement| placement.cloned().unwrap_or_default());
        if !ground.crs.is_empty() && !surface.crs.is_empty() && ground.crs != surface.crs {
            return Err(Error::format("the files are in different coordinate reference systems"));
        }
        let is_near = |x: f64| x.abs() <= LARGEST;
        let has_place = |place: &Placement| {
            place.origin.iter().copied().all(is_near)
                && place.unit.is_none_or(|unit| is_near(unit) && is_near(1.0 / unit))
        };
        if !has_place(&ground) || !has_place(&surface) {
            return Err(Error::format("a file has a unit or an origin beyond 10^15"));
        }
        Ok(Self {
            units: [ground.unit, surface.unit].map(|unit| unit.unwrap_or(1.0)),
            origins: [ground.origin, surface.origin],
            is_y_up: match [ground.up, surface.up] {
                [UpAxis::Unknown, up] | [up, UpAxis::Unknown] => [up == UpAxis::Y; 2],
                ups => ups.map(|up| up == UpAxis::Y),
            },
        })
    }

    /// The frame of these heights under a surface with this placement.
    ///
    /// # Errors
    /// As [`Self::new`], and [`Error::Format`] if the heights lie on a globe.
    pub fn under(heights: &HeightsIndex, surface: Option<&Placement>) -> Result<Self> {
        if heights.surface().is_globe() {
            return Err(Error::format("the ground of a mesh lies on a globe, not on a plane"));
        }
        Self::new(heights.placement(), surface)
    }

    /// Whether coordinates stay as they are.
    pub fn is_identity(&self) -> bool {
        self.is_in_place() && self.is_y_up[0] == self.is_y_up[1]
    }

    /// How long a unit of the ground is in units of the surface.
    pub fn scale(&self) -> f64 {
        if self.is_in_place() { 1.0 } else { self.units[0] / self.units[1] }
    }

    /// The rows of the matrix that takes coordinates of the ground to those of the surface: [`Self::point`], but for
    /// rounding. The fourth column is what is added.
    pub fn surface_from_ground(&self) -> [[f64; 4]; 3] {
        rows(self.point([0.0; 3]), |axis| self.direction(axis.map(|x| x * self.scale())))
    }

    /// The way back: [`Self::point_of_ground`], but for rounding.
    pub fn ground_from_surface(&self) -> [[f64; 4]; 3] {
        rows(self.point_of_ground([0.0; 3]), |axis| self.direction_of_ground(axis.map(|x| x / self.scale())))
    }

    /// A point of the ground in the space of the surface.
    pub fn point(&self, point: [f64; 3]) -> [f64; 3] {
        moved(self.is_y_up, point, |p| match self.is_in_place() {
            true => p,
            false => {
                [0, 1, 2].map(|k| ((p[k] * self.units[0] + self.origins[0][k]) - self.origins[1][k]) / self.units[1])
            }
        })
    }

    /// A point of the surface's space in that of the ground: the way back, but for rounding.
    pub fn point_of_ground(&self, point: [f64; 3]) -> [f64; 3] {
        let [ground, surface] = self.is_y_up;
        moved([surface, ground], point, |p| match self.is_in_place() {
            true => p,
            false => {
                [0, 1, 2].map(|k| ((p[k] * self.units[1] + self.origins[1][k]) - self.origins[0][k]) / self.units[0])
            }
        })
    }

    /// A direction of the ground in the space of the surface.
    pub fn direction<T: Copy + std::ops::Neg<Output = T>>(&self, direction: [T; 3]) -> [T; 3] {
        moved(self.is_y_up, direction, |direction| direction)
    }

    /// The way back: a direction of the surface in the space of the ground.
    pub fn direction_of_ground<T: Copy + std::ops::Neg<Output = T>>(&self, direction: [T; 3]) -> [T; 3] {
        let [ground, surface] = self.is_y_up;
        moved([surface, ground], direction, |direction| direction)
    }

    /// A view of the surface as a view of the ground: both fill the same pixels, and have the same depths in a depth
    /// buffer.
    pub fn view_of_ground(&self, view: &View) -> View {
        View {
            position: self.point_of_ground(view.position),
            forward: self.direction_of_ground(view.forward),
            up: self.direction_of_ground(view.up),
            near: view.near / self.scale(),
            ..*view
        }
    }

    /// A box of the surface's space in that of the ground.
    pub fn bounds_of_ground(&self, bounds: [[f64; 3]; 2]) -> [[f64; 3]; 2] {
        let [a, b] = bounds.map(|corner| self.point_of_ground(corner));
        [[0, 1, 2].map(|k| a[k].min(b[k])), [0, 1, 2].map(|k| a[k].max(b[k]))]
    }

    /// A box of the ground in the space of the surface.
    pub fn bounds(&self, bounds: [[f64; 3]; 2]) -> [[f64; 3]; 2] {
        let [a, b] = bounds.map(|corner| self.point(corner));
        [[0, 1, 2].map(|k| a[k].min(b[k])), [0, 1, 2].map(|k| a[k].max(b[k]))]
    }

    fn is_in_place(&self) -> bool {
        self.units[0] == self.units[1] && self.origins[0] == self.origins[1]
    }
}

/// From one space to another, of which y may be up, with a way between them where z is.
fn moved<T: Copy + std::ops::Neg<Output = T>>(
    [from, to]: [bool; 2],
    [x, y, z]: [T; 3],
    way: impl Fn([T; 3]) -> [T; 3],
) -> [T; 3] {
    let [x, y, z] = way(if from { [x, -z, y] } else { [x, y, z] });
    if to { [x, z, -y] } else { [x, y, z] }
}

/// The rows of a matrix, from what it makes of the origin and of an axis.
fn rows(origin: [f64; 3], turned: impl Fn([f64; 3]) -> [f64; 3]) -> [[f64; 4]; 3] {
    let [x, y, z] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(turned);
    // Adding zero makes no other number of anything but a negative zero.
    [0, 1, 2].map(|row| [x[row], y[row], z[row], origin[row]].map(|number| number + 0.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn placed(up: UpAxis, unit: f64, origin: [f64; 3], crs: &str) -> Placement {
        Placement { up, unit: Some(unit), origin, crs: crs.into() }
    }

    #[test]
    fn a_ground_is_turned_scaled_and_moved_to_its_surface_and_back() {
        let ground = placed(UpAxis::Z, 1.0, [0.0; 3], "EPSG:32632");
        let surface = placed(UpAxis::Y, 0.5, [500_000.0, 5_000_000.0, 100.0], "");
        let frame = GroundFrame::new(Some(&ground), Some(&surface)).unwrap();
        let point = [500_010.0, 5_000_020.0, 103.0];
        assert_eq!(frame.point(point), [20.0, 6.0, -40.0]);
        assert_eq!(frame.point_of_ground([20.0, 6.0, -40.0]), point);
        assert_eq!((frame.scale(), frame.direction([1, 2, 3])), (2.0, [1, 3, -2]));
        assert_eq!(frame.direction_of_ground([1, 3, -2]), [1, 2, 3]);
        let by =
            |rows: [[f64; 4]; 3], [x, y, z]: [f64; 3]| rows.map(|row| row[0] * x + row[1] * y + row[2] * z + row[3]);
        assert_eq!(by(frame.surface_from_ground(), point), [20.0, 6.0, -40.0]);
        assert_eq!(by(frame.ground_from_surface(), [20.0, 6.0, -40.0]), point);
        let bounds = frame.bounds([[500_000.0, 5_000_000.0, 100.0], point]);
        assert_eq!(bounds, [[0.0, 0.0, -40.0], [20.0, 6.0, 0.0]]);
        assert_eq!(frame.bounds_of_ground(bounds), [[500_000.0, 5_000_000.0, 100.0], point]);
    }

    #[test]
    fn what_is_placed_alike_stays_bit_for_bit_and_another_crs_is_refused() {
        let feet = placed(UpAxis::Z, 0.3048, [1.1, 2.2, 3.3], "EPSG:2225");
        let frame = GroundFrame::new(Some(&feet), Some(&feet)).unwrap();
        assert!(frame.is_identity() && frame.point([0.1, 0.7, 1e9]) == [0.1, 0.7, 1e9]);
        assert!(GroundFrame::new(None, None).unwrap().is_identity());
        let other = Placement { crs: "EPSG:32633".into(), ..feet.clone() };
        assert!(GroundFrame::new(Some(&feet), Some(&other)).unwrap_err().to_string().contains("another coordinate"));
        assert!(GroundFrame::new(Some(&feet), None).is_ok());
        let far = Placement { origin: [0.0, 2e15, 0.0], ..feet.clone() };
        assert!(GroundFrame::new(Some(&far), None).is_err());
        assert!(GroundFrame::new(None, Some(&Placement { unit: Some(1e-300), ..feet })).is_err());
    }

    #[test]
    fn files_with_other_axes_up_meet_in_the_world() {
        let map = placed(UpAxis::Z, 1.0, [100.0, 200.0, 0.0], "");
        let model = placed(UpAxis::Y, 0.25, [110.0, 220.0, 3.0], "");
        // The model's second axis is the map's third one, and its third one goes south.
        let frame = GroundFrame::between(Some(&model), Some(&map)).unwrap();
        assert_eq!(frame.point([4.0, 8.0, 12.0]), [11.0, 17.0, 5.0]);
        assert_eq!(frame.point_of_ground([11.0, 17.0, 5.0]), [4.0, 8.0, 12.0]);
        let back = GroundFrame::between(Some(&map), Some(&model)).unwrap();
        assert_eq!(back.point([11.0, 17.0, 5.0]), [4.0, 8.0, 12.0]);
        let other = placed(UpAxis::Y, 0.25, [111.0, 220.0, 3.0], "");
        let frame = GroundFrame::between(Some(&other), Some(&model)).unwrap();
        assert_eq!((frame.point([0.0, 1.0, 2.0]), frame.direction([1, 2, 3])), ([4.0, 1.0, 2.0], [1, 2, 3]));
        let unsaid = Placement { up: UpAxis::Unknown, ..other };
        assert_eq!(GroundFrame::between(Some(&unsaid), Some(&model)).unwrap(), frame);
        let elsewhere = Placement { crs: "EPSG:1".into(), ..map.clone() };
        assert!(GroundFrame::between(Some(&Placement { crs: "EPSG:2".into(), ..map }), Some(&elsewhere)).is_err());
    }

    #[test]
    fn a_view_of_the_ground_fills_the_same_pixels() {
        let surface = placed(UpAxis::Y, 0.5, [100.0, 200.0, 10.0], "");
        let frame = GroundFrame::new(None, Some(&surface)).unwrap();
        let view = View { position: [1.0, 2.0, 3.0], forward: [0.0, -1.0, -1.0], near: 0.5, ..View::default() };
        let below = frame.view_of_ground(&view);
        let point = [130.0, 260.0, 4.0];
        let seen = |view: &View, point: [f64; 3]| {
            let offset = [0, 1, 2].map(|k| point[k] - view.position[k]);
            view.axes().map(|axis| (0..3).map(|k| axis[k] * offset[k]).sum::<f64>() / view.near)
        };
        let [on_surface, on_ground] = [seen(&view, frame.point(point)), seen(&below, point)];
        assert!((0..3).all(|k| (on_surface[k] - on_ground[k]).abs() < 1e-9), "{on_surface:?} {on_ground:?}");
    }
}
