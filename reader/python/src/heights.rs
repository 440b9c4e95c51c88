//! An open file of heights, and its answers.

use crate::{
    array::Array,
    error::exception,
    reader::{Point, run},
    source::Source,
};
use lodpack::{
    heights::{Base, DrapeImage, Heights, HeightsMesh, HeightsQuery},
    source::Counting,
};
use pyo3::{
    Py, PyErr, PyResult, Python, pyclass, pymethods,
    types::{PyDict, PyDictMethods},
};
use std::sync::Arc;

/// An open file of heights.
#[pyclass(frozen, module = "lodpack._lodpack")]
pub struct HeightsReader {
    pub(crate) file: Arc<Heights<Counting<Source>>>,
    pub(crate) name: Arc<str>,
}

/// Positions, triangles, the tile of each triangle, normals, and colours if there is a ramp.
type Arrays = (Array, Array, Array, Array, Option<Array>);

impl HeightsReader {
    /// Asks the file without holding Python up.
    fn ask<T: Send + 'static>(
        &self,
        py: Python<'_>,
        question: impl FnOnce(&Heights<Counting<Source>>) -> lodpack::Result<T> + Send + 'static,
    ) -> PyResult<T> {
        let file = Arc::clone(&self.file);
        // All of it may take long.
        run(py, true, move || question(&file))?.map_err(|error| exception(py, &self.name, error))
    }
}

#[pymethods]
impl HeightsReader {
    #[getter]
    fn name(&self) -> &str {
        &self.name
    }

    #[getter]
    fn bytes_read(&self) -> u64 {
        self.file.source().byte_count()
    }

    #[getter]
    fn request_count(&self) -> u64 {
        self.file.source().read_count()
    }

    #[getter]
    fn bounds(&self) -> Option<(Point, Point)> {
        self.file.index().bounds().map(|[low, high]| (low.into(), high.into()))
    }

    /// What is known without reading more, under the names that `lodpack info --json` has for it.
    fn info(&self, py: Python<'_>) -> PyResult<Py<PyDict>> {
        let (grid, surface, about) = (self.file.grid(), self.file.surface(), self.file.info());
        let info = PyDict::new(py);
        let (major, minor) = self.file.index().version();
        info.set_item("holds", "heights")?;
        info.set_item("version", format!("{major}.{minor}"))?;
        info.set_item("generator", self.file.source_info().map_or("", |source| &source.generator))?;
        let [columns, rows] = grid.samples();
        info.set_item("columns", columns)?;
        info.set_item("rows", rows)?;
        let name = match surface.base {
            Base::Plane => "plane",
            Base::Ellipsoid { eccentricity: 0.0, .. } => "sphere",
            Base::Ellipsoid { .. } => "ellipsoid",
        };
        info.set_item("surface", name)?;
        info.set_item("first", (surface.first[0], surface.first[1]))?;
        info.set_item("spacing", (surface.spacing[0], surface.spacing[1]))?;
        info.set_item("wraps", grid.wraps())?;
        info.set_item("poles", (grid.poles()[0], grid.poles()[1]))?;
        info.set_item("step", about.step)?;
        info.set_item("sample_error", about.sample_error)?;
        info.set_item("unit", about.unit)?;
        info.set_item("height_scale", surface.height_scale)?;
        info.set_item("depth_count", grid.depth() + 1)?;
        let ramp = self.file.ramp().map(|ramp| {
            let stops: Vec<(f64, (u8, u8, u8))> =
                ramp.stops().iter().map(|stop| (stop.height, stop.colour.into())).collect();
            let entry = PyDict::new(py);
            entry.set_item("name", &about.ramp)?;
            entry.set_item("stops", stops)?;
            Ok::<_, PyErr>(entry)
        });
        info.set_item("ramp", ramp.transpose()?)?;
        let drape = self.file.drape().map(|drape| {
            let entry = PyDict::new(py);
            entry.set_item("size", (drape.size[0], drape.size[1]))?;
            entry.set_item("first", (drape.first[0], drape.first[1]))?;
            entry.set_item("spacing", (drape.spacing[0], drape.spacing[1]))?;
            entry.set_item("has_opacity", drape.components == 4)?;
            entry.set_item("bytes", self.file.index().drape_bytes())?;
            Ok::<_, PyErr>(entry)
        });
        info.set_item("drape", drape.transpose()?)?;
        let placement = self.file.placement();
        info.set_item("crs", placement.map_or("", |placement| &placement.crs))?;
        let origin = placement.map_or([0.0; 3], |placement| placement.origin);
        info.set_item("origin", (origin[0], origin[1], origin[2]))?;
        info.set_item("bounds", self.bounds())?;
        Ok(info.unbind())
    }

    /// The mesh of the cut for a query: its error, why it is not finer, and its arrays.
    #[pyo3(signature = (*, tolerance=None, bbox=None, max_triangles=None))]
    fn extract(
        &self,
        py: Python<'_>,
        tolerance: Option<f64>,
        bbox: Option<[[f64; 2]; 2]>,
        max_triangles: Option<u64>,
    ) -> PyResult<(f64, &'static str, Arrays)> {
        let query = HeightsQuery { bounds: bbox, tolerance, max_triangles };
        let (cut, mesh, colours) = self.ask(py, move |file| {
            let cut = file.cut(&query)?;
            let mesh = file.mesh(&cut)?;
            let colours = file.colours(&cut, &mesh)?;
            Ok((cut, mesh, colours))
        })?;
        let limited_by = cut.limiter.name();
        let HeightsMesh { positions, triangles, triangle_tiles, normals, .. } = mesh;
        let normals: Vec<[f32; 3]> = normals.into_iter().map(|normal| normal.map(|x| f32::from(x) / 32767.0)).collect();
        let arrays = (
            Array::triples(positions),
            Array::triples(triangles),
            Array::flat(triangle_tiles),
            Array::triples(normals),
            colours.map(Array::triples),
        );
        Ok((cut.error, limited_by, arrays))
    }

    /// The heights of some columns and rows, row by row; NaN where there are none.
    fn window(&self, py: Python<'_>, columns: (u64, u64), rows: (u64, u64)) -> PyResult<Array> {
        let heights = self.ask(py, move |file| file.window(columns.0..columns.1, rows.0..rows.1))?;
        let shape = [rows.1 - rows.0, columns.1 - columns.0].map(|count| count as usize);
        Ok(Array::shaped(heights, &shape))
    }

    /// The image over some columns and rows, with at most so many texels along each side: its texels, where the corner
    /// of its first texel is, and the distance of texels, in columns and rows. None where there is no image.
    #[expect(clippy::type_complexity, reason = "Python takes it apart")]
    fn image(
        &self,
        py: Python<'_>,
        columns: (f64, f64),
        rows: (f64, f64),
        most: u32,
    ) -> PyResult<Option<(Array, (f64, f64), (f64, f64))>> {
        let found = self.ask(py, move |file| {
            let drape = file.drape();
            let window = drape.and_then(|drape| drape.window_of_size(columns.into(), rows.into(), most));
            window.map(|window| file.drape_image(&window)).transpose()
        })?;
        Ok(found.map(|DrapeImage { image, first, spacing }| {
            let shape = [image.size[1] as usize, image.size[0] as usize, image.components.into()];
            (Array::shaped(image.data, &shape), first.into(), spacing.into())
        }))
    }

    /// Reads every tile, and checks every checksum.
    fn verify(&self, py: Python<'_>) -> PyResult<()> {
        self.ask(py, Heights::verify)
    }
}
