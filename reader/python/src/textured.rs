//! Meshes with what the surface carries: values at vertices, and pages with places in them.

use std::sync::Arc;

use lodpack::{
    decode::{PagedMesh, TexturedMesh},
    index::ChannelInfo,
};
use pyo3::{Py, PyResult, Python, pyclass, pymethods, types::PyList, types::PyListMethods};

use crate::{array::Array, error::raise, reader::arrays};

/// A mesh with images of some channels.
#[pyclass(frozen, module = "lodpack._lodpack")]
pub struct Textured {
    mesh: Arc<TexturedMesh>,
    channels: Vec<ChannelInfo>,
}

impl Textured {
    pub fn new(mesh: TexturedMesh, channels: Vec<ChannelInfo>) -> Self {
        Self { mesh: Arc::new(mesh), channels }
    }

    fn channel(&self, py: Python<'_>, channel: usize) -> PyResult<&ChannelInfo> {
        self.channels
            .get(channel)
            .ok_or_else(|| raise(py, "QueryError", format!("there is no channel {channel} in this mesh")))
    }
}

#[pymethods]
impl Textured {
    /// Positions, triangles, and for each triangle the number of its node: as without channels.
    fn mesh(&self) -> (Array, Array, Array) {
        arrays(self.mesh.mesh.clone())
    }

    /// The colour of each vertex: red, green, blue and opacity. White where nothing is known.
    fn vertex_colours(&self, py: Python<'_>, channel: usize) -> PyResult<Array> {
        let kind = self.channel(py, channel)?.kind;
        let mesh = Arc::clone(&self.mesh);
        let colours: Vec<u8> = py.detach(move || {
            let colour = |values: Option<[f64; 4]>| {
                let [red, green, blue, alpha] = values.unwrap_or([255.0; 4]);
                [red, green, blue, if alpha.is_nan() { 255.0 } else { alpha }].map(|x| (x + 0.5) as u8)
            };
            mesh.vertex_values(channel, kind).into_iter().flat_map(colour).collect()
        });
        let count = colours.len() / 4;
        Ok(Array::shaped(colours, &[count, 4]))
    }

    /// The values of a channel at each vertex; NaN where nothing is known.
    fn vertex_values(&self, py: Python<'_>, channel: usize) -> PyResult<Array> {
        let info = self.channel(py, channel)?;
        let &ChannelInfo { kind, low, step, .. } = info;
        let (mesh, components) = (Arc::clone(&self.mesh), info.value_count());
        let values: Vec<f64> = py.detach(move || {
            let value = |numbers: Option<[f64; 4]>| {
                numbers.unwrap_or([f64::NAN; 4]).into_iter().take(components).map(|number| low + step * number)
            };
            mesh.vertex_values(channel, kind).into_iter().flat_map(value).collect()
        });
        let count = values.len() / components.max(1);
        Ok(Array::shaped(values, &[count, components]))
    }

    /// Positions, triangles and their nodes, and the places of vertices in one page, from the lower left corner; and
    /// that page of each channel. Where triangles do not agree about the place of a vertex, it is there several times.
    fn paged(&self, py: Python<'_>) -> PyResult<(Array, Array, Array, Array, Py<PyList>)> {
        let mesh = Arc::clone(&self.mesh);
        let paged = py.detach(move || PagedMesh::new(&mesh, u32::MAX));
        let pages = PyList::empty(py);
        for (number, channel) in self.channels.iter().enumerate() {
            let (mesh, paged) = (Arc::clone(&self.mesh), &paged);
            let page = if channel.is_of_bytes() {
                let pages = py.detach(move || paged.colours(&mesh, number));
                pages.into_iter().next().map(|page| array_of(page.data, page.size, page.components))
            } else {
                let pages = py.detach(move || paged.values(&mesh, number));
                pages.into_iter().next().map(|page| array_of(page.data, page.size, page.components))
            };
            pages.append(Py::new(py, page.unwrap_or_else(|| Array::shaped(Vec::<u8>::new(), &[0, 0, 3])))?)?;
        }
        let places: Vec<f32> = paged.places.iter().flat_map(|&[u, v]| [u, 1.0 - v]).collect();
        let count = paged.positions.len();
        let triangles: Vec<[u32; 3]> = paged.triangles.concat();
        Ok((
            Array::triples(paged.positions),
            Array::triples(triangles),
            Array::flat(paged.triangle_nodes.concat()),
            Array::shaped(places, &[count, 2]),
            pages.unbind(),
        ))
    }
}

/// An image as an array of rows, texels and components.
fn array_of<T: crate::array::Element>(data: Vec<T>, size: [u32; 2], components: u8) -> Array {
    let [width, height] = size.map(|length| length as usize);
    Array::shaped(data, &[height, width, components.into()])
}
