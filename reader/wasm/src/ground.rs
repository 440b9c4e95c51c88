//! The ground that a mesh stands on. It is opened by an instance of its own, as a file of heights; this one says where
//! it lies, and that one where it is in the space of the mesh.

use lodpack::{
    Error, GroundFrame,
    index::{Placement, UpAxis},
};

use crate::{
    answer::{Answer, Put, floats, wrong},
    state::State,
};

/// Bytes of the numbers before the name of a CRS.
const PLACE_BYTES: usize = 40;

impl State {
    /// Where the ground lies in the file: offset and length (f64); and then where the mesh is, for
    /// [`Self::ground_frame`]. Returns 0 if there is none.
    pub fn ground(&mut self) -> Answer {
        let index = self.index()?.clone();
        let Some(range) = index.ground_range() else { return Ok(0) };
        self.output.put_floats([range.start as f64, (range.end - range.start) as f64]);
        let Placement { up, unit, origin, crs } = index.placement().cloned().unwrap_or_default();
        let is_y_up = if up == UpAxis::Y { 1.0 } else { 0.0 };
        self.output.put_floats([is_y_up, unit.unwrap_or(f64::NAN)].into_iter().chain(origin));
        self.output.extend(crs.bytes());
        Ok(1)
    }

    /// Of an open ground: its scale, and the rows of the matrices to the space of the mesh and back (f64). The input is
    /// where the mesh is.
    pub fn ground_frame(&mut self) -> Answer {
        let (numbers, crs) =
            self.input.split_at_checked(PLACE_BYTES).ok_or_else(|| wrong("where the mesh is takes five numbers"))?;
        let numbers: Vec<f64> = floats(numbers).collect();
        let &[is_y_up, unit, x, y, z] = numbers.as_slice() else { return Err(wrong("it takes five numbers")) };
        let mesh = Placement {
            up: if is_y_up == 1.0 { UpAxis::Y } else { UpAxis::Unknown },
            unit: (!unit.is_nan()).then_some(unit),
            origin: [x, y, z],
            crs: String::from_utf8_lossy(crs).into_owned(),
        };
        let ground = self.heights_index().map_err(|_| Error::Format {
            what: "the ground of a mesh is no file of heights",
            location: "section ground".into(),
        })?;
        let frame = GroundFrame::under(ground, Some(&mesh))?;
        self.output.put_floats([frame.scale()]);
        self.output
            .put_floats([frame.surface_from_ground(), frame.ground_from_surface()].into_iter().flatten().flatten());
        Ok(0)
    }
}
