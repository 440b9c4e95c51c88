//! Surfaces of all kinds that can be compared, and the coordinates in which they are.

use super::super::open::{Opened, Source, in_file, open_any, tolerance_in, tolerance_in_heights};
use crate::args::{CompareArgs, LevelChoice};
use anyhow::{Context, Result, bail};
use glam::{DMat4, DVec3};
use lodpack::heights::{Heights, HeightsQuery};
use lodpack::index::{Placement, UpAxis};
use lodpack::{File, Query};
use lodpack_cli::import::raster::{HeightSource, RasterOptions, SurfaceKind, is_raster};
use lodpack_cli::import::{find_inputs, import_shape};
use lodpack_cli::mesh::Mesh;
use lodpack_cli::mesh::tolerance::Tolerance;
use lodpack_cli::mesh::upright::Upright;
use lodpack_cli::progress::{Progress, Silent};
use lodpack_cli::tileset::{GltfLevels, Level, Projection, Terrain, Tileset, is_on_wgs84, is_tileset, place};
use std::path::{Path, PathBuf};

/// The coordinates in which a surface is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Space {
    /// Those of its own file.
    Own,
    /// Metres, y up.
    Gltf,
    /// Metres, z up or from the middle of the earth.
    Tiles,
}

impl Space {
    pub fn text(self) -> &'static str {
        match self {
            Self::Own => "in the units and axes of the files",
            Self::Gltf => "metres with y up, as in glTF",
            Self::Tiles => "metres, with z up or from the middle of the earth, as in 3D Tiles",
        }
    }
}

enum Content {
    Mesh,
    Raster(Box<HeightSource>, RasterOptions),
    File(Box<File<Source>>),
    Heights(Box<Heights<Source>>),
    Gltf(Option<GltfLevels>),
    Tiles(Tileset),
    Terrain(Terrain),
}

/// A surface that is compared.
pub struct Surface {
    path: PathBuf,
    content: Content,
    placement: Option<Placement>,
}

/// One of its levels.
pub struct Chosen {
    pub name: String,
    /// What it says of its own error, in the units of its file, and how that is called.
    pub claimed: Option<f64>,
    pub claim: &'static str,
    /// Whether that is said of samples alone.
    pub is_of_samples: bool,
    number: usize,
    tiles: Option<Level>,
    tolerance: Option<f64>,
}

impl Surface {
    /// Opens a surface. `is_beside_terrain` says that the other one lies on the globe.
    pub fn open(path: &Path, args: &CompareArgs, is_beside_terrain: bool) -> Result<Self> {
        let is_address = path.to_str().is_some_and(|text| text.contains("://"));
        let of = |content, placement| Ok(Self { path: path.to_owned(), content, placement });
        if !is_address {
            std::fs::metadata(path).with_context(|| format!("cannot open {}", path.display()))?;
            if let Some(terrain) = Terrain::open(path)? {
                return of(Content::Terrain(terrain), None);
            }
            if is_tileset(path) {
                return of(Content::Tiles(Tileset::open(path)?), None);
            }
            if is_raster(path) {
                let mut options = args.raster.options();
                if is_beside_terrain && options.surface == SurfaceKind::Plane {
                    options.surface = SurfaceKind::Wgs84;
                }
                let Some(source) = HeightSource::open(&[path.to_owned()], &options, &Silent)? else {
                    bail!("{} is no raster that can be read", path.display())
                };
                let placement = Some(source.placement.clone());
                return of(Content::Raster(Box::new(source), options), placement);
            }
            let is_gltf =
                path.extension().is_some_and(|e| e.eq_ignore_ascii_case("glb") || e.eq_ignore_ascii_case("gltf"));
            if is_gltf {
                return of(Content::Gltf(GltfLevels::open(path)?), None);
            }
            if !is_lodpack(path) {
                return of(Content::Mesh, None);
            }
        } else if path.extension().is_none_or(|extension| extension != "lodpack") {
            bail!(
                "{}: only .lodpack files are read from addresses; download it, and name it by its path",
                path.display()
            );
        }
        match open_any(path)? {
            Opened::Mesh(file) => {
                let placement = file.placement().cloned();
                of(Content::File(Box::new(file)), placement)
            }
            Opened::Heights(file) => {
                let placement = file.placement().cloned();
                of(Content::Heights(Box::new(file)), placement)
            }
        }
    }

    pub fn kind(&self) -> &'static str {
        match self.content {
            Content::Mesh => "a mesh",
            Content::Raster(..) => "a raster of heights",
            Content::File(_) => "a .lodpack file",
            Content::Heights(_) => "a .lodpack file of heights",
            Content::Gltf(_) => "glTF",
            Content::Tiles(_) => "3D Tiles",
            Content::Terrain(_) => "quantized-mesh",
        }
    }

    pub fn space(&self) -> Space {
        match self.content {
            Content::Mesh | Content::Raster(..) | Content::File(_) | Content::Heights(_) => Space::Own,
            Content::Gltf(_) => Space::Gltf,
            Content::Tiles(_) | Content::Terrain(_) => Space::Tiles,
        }
    }

    pub fn is_raster(&self) -> bool {
        matches!(self.content, Content::Raster(..))
    }

    /// Whether it is a grid around a globe.
    fn is_globe(&self) -> bool {
        match &self.content {
            Content::Raster(source, _) => source.surface.is_globe(),
            Content::Heights(file) => file.surface().is_globe(),
            _ => false,
        }
    }

    pub fn is_terrain(&self) -> bool {
        matches!(self.content, Content::Terrain(_))
    }

    /// The edges of a grid in degrees on the globe: west, south, east, north.
    pub fn edges(&self) -> Option<[f64; 4]> {
        let (surface, cells) = match &self.content {
            Content::Raster(source, _) => (source.surface, source.grid.cells()),
            Content::Heights(file) => (*file.surface(), file.grid().cells()),
            _ => return None,
        };
        let last = [0, 1].map(|axis| surface.first[axis] + surface.spacing[axis] * cells[axis] as f64);
        is_on_wgs84(&surface).then_some([surface.first[0], last[1].max(-90.0), last[0], surface.first[1].min(90.0)])
    }

    /// The finest level.
    pub fn finest(&self) -> Result<Chosen> {
        let all = self.chosen(Some(LevelChoice::Finest), None)?;
        all.into_iter().next().with_context(|| format!("{}: there is nothing to compare", self.path.display()))
    }

    /// The levels that are asked for, the coarsest first.
    pub fn chosen(&self, choice: Option<LevelChoice>, tolerance: Option<Tolerance>) -> Result<Vec<Chosen>> {
        let name = self.path.display();
        let one = |name: &str, number: usize, claimed: Option<f64>, claim: &'static str| Chosen {
            name: name.to_owned(),
            claimed,
            claim,
            is_of_samples: false,
            number,
            tiles: None,
            tolerance: None,
        };
        let of_level = |level: Level| Chosen {
            claimed: Some(level.claimed),
            tiles: Some(level.clone()),
            ..one(&format!("depth {}", level.depth), 0, None, "geometricError")
        };
        let mut all = match (&self.content, tolerance) {
            (Content::Mesh | Content::Raster(..) | Content::Gltf(None), None) => vec![one("surface", 0, None, "")],
            (Content::File(file), tolerance) => {
                let asked = tolerance.map(|tolerance| tolerance_in(file, tolerance)).transpose()?;
                match (asked, choice) {
                    (None, None | Some(LevelChoice::Finest)) | (Some(_), _) => {
                        let query = Query { tolerance: asked, ..Query::default() };
                        let cut = in_file(&self.path, file.select(&query))?;
                        vec![Chosen { tolerance: asked, ..one("cut", 0, Some(cut.error), "certified error") }]
                    }
                    _ => {
                        let levels = 0..file.level_count();
                        let error = |level: usize| file.level(level).map(|level| level.max_error);
                        let of =
                            |level: usize| one(&format!("level {level}"), level + 1, error(level), "certified error");
                        levels.map(of).collect()
                    }
                }
            }
            (Content::Heights(file), tolerance) => {
                let asked = tolerance.map(|tolerance| tolerance_in_heights(file, tolerance)).transpose()?;
                let query = HeightsQuery { tolerance: asked, ..HeightsQuery::default() };
                let cut = in_file(&self.path, file.cut(&query))?;
                let of = one("cut", 0, Some(cut.error), "certified error of samples");
                vec![Chosen { tolerance: asked, is_of_samples: true, ..of }]
            }
            (Content::Gltf(Some(levels)), None) => {
                let of = |level: usize| one(&format!("level {level}"), level, levels.claimed(level), "certified error");
                (0..levels.count()).rev().map(of).collect()
            }
            (Content::Tiles(tileset), None) => tileset.levels().into_iter().map(of_level).collect(),
            (Content::Tiles(tileset), Some(Tolerance::InputUnits(length) | Tolerance::Metres(length))) => {
                vec![Chosen { name: "cut".into(), ..of_level(tileset.within(length)) }]
            }
            (Content::Terrain(terrain), None) => {
                let of = |level: u32| {
                    one(
                        &format!("level {level}"),
                        level as usize,
                        Some(Terrain::assumed_error(level)),
                        "error that Cesium assumes",
                    )
                };
                terrain.levels().into_iter().map(of).collect()
            }
            (_, Some(_)) => bail!("{name} is {}, of which --tolerance chooses nothing; omit it", self.kind()),
        };
        match choice.filter(|_| all.len() > 1) {
            None | Some(LevelChoice::All) => {}
            Some(LevelChoice::Finest) => all = all.pop().into_iter().collect(),
            Some(LevelChoice::Number(number)) => {
                let ends = format!(" {number}");
                let names: Vec<String> = all.iter().map(|level| level.name.clone()).collect();
                all.retain(|level| level.name.ends_with(&ends));
                if all.is_empty() {
                    bail!("{name} has no level {number}; it has {}", names.join(", "));
                }
            }
        }
        if all.is_empty() {
            bail!("{name}: no tile has content that could be compared");
        }
        Ok(all)
    }

    /// The triangles of a level, in its own coordinates, and terrain within edges.
    pub fn mesh(&self, chosen: &Chosen, within: Option<[f64; 4]>, progress: &dyn Progress) -> Result<Mesh> {
        let whole = |positions: Vec<[f64; 3]>, triangles| Mesh {
            positions: positions.into_iter().map(DVec3::from_array).collect(),
            triangles,
        };
        let mesh = match &self.content {
            Content::Mesh | Content::Gltf(None) => {
                let inputs = find_inputs(std::slice::from_ref(&self.path), "atlas.json", progress)?;
                import_shape(&inputs, &RasterOptions::default(), progress)?
            }
            Content::Raster(_, options) => import_shape(std::slice::from_ref(&self.path), options, progress)?,
            Content::File(file) => {
                let cut = match chosen.number.checked_sub(1) {
                    None => file.select(&Query { tolerance: chosen.tolerance, ..Query::default() }),
                    Some(level) => file.uniform_cut(level as u8),
                };
                let mesh = in_file(&self.path, cut.and_then(|cut| file.extract(&cut)))?;
                whole(mesh.positions, mesh.triangles)
            }
            Content::Heights(file) => {
                let query = HeightsQuery { tolerance: chosen.tolerance, ..HeightsQuery::default() };
                let mesh = in_file(&self.path, file.cut(&query).and_then(|cut| file.mesh(&cut)))?;
                whole(mesh.positions, mesh.triangles)
            }
            Content::Gltf(Some(levels)) => levels.mesh(chosen.number, progress)?,
            Content::Tiles(tileset) => match &chosen.tiles {
                Some(level) => tileset.mesh(level, progress)?,
                None => Mesh::default(),
            },
            Content::Terrain(terrain) => terrain.mesh(chosen.number as u32, within, progress)?,
        };
        if mesh.triangles.is_empty() {
            bail!("{}: {} has no triangles to compare", self.path.display(), chosen.name);
        }
        Ok(mesh)
    }

    /// Takes positions to a space, and returns how many units of that one of its own is.
    pub fn take_to(&self, space: Space, mesh: &mut Mesh, args: &CompareArgs) -> Result<f64> {
        let is_heights = matches!(self.content, Content::Raster(..) | Content::Heights(_));
        let mut placement = self.placement.clone().unwrap_or_default();
        if is_heights && placement.up == UpAxis::Unknown {
            placement.up = UpAxis::Z;
        }
        if args.local {
            placement = Placement { crs: String::new(), origin: [0.0; 3], ..placement };
        }
        let unit = placement.unit.unwrap_or(1.0);
        match (self.space(), space) {
            (own, space) if own == space => Ok(1.0),
            (Space::Own, Space::Gltf) => {
                let upright = match (self.is_globe(), is_heights) {
                    // A globe has no axis that points up.
                    (true, _) => Upright::default(),
                    (false, true) => Upright::along_z(Some(&placement)),
                    (false, false) => Upright::of(Some(&placement)),
                };
                for p in &mut mesh.positions {
                    *p = upright.unit * if upright.is_z_up { DVec3::new(p.x, p.z, -p.y) } else { *p };
                }
                Ok(upright.unit)
            }
            (Space::Gltf, _) => {
                mesh.positions.iter_mut().for_each(|p| *p = DVec3::new(p.x, -p.z, p.y));
                Ok(1.0)
            }
            _ => {
                if let Some(projection) = Projection::of(&placement).filter(|_| is_heights && args.up.is_none()) {
                    mesh.positions.iter_mut().for_each(|p| *p = projection.ecef(p.to_array()).into());
                    return Ok(unit);
                }
                let up = args.up.map(|up| up.axis());
                let placed = place(&placement, up, mesh.bounds().map(|p| p.to_array())).with_context(|| {
                    format!("cannot take {} to the coordinates of the other surface", self.path.display())
                })?;
                let [x, y, z] = placed.frame.axes.map(DVec3::from_array);
                let origin = DVec3::from_array(placed.frame.origin);
                mesh.positions.iter_mut().for_each(|p| *p = origin + x * p.x + y * p.y + z * p.z);
                Ok(unit)
            }
        }
    }
}

/// Takes positions through a matrix.
pub fn transform(matrix: &[f64; 16], positions: &mut [DVec3]) {
    let matrix = DMat4::from_cols_array(matrix);
    positions.iter_mut().for_each(|p| *p = matrix.transform_point3(*p));
}

fn is_lodpack(path: &Path) -> bool {
    use std::io::Read;
    let mut start = [0; 8];
    let read = std::fs::File::open(path).and_then(|mut file| file.read_exact(&mut start));
    read.is_ok() && start.starts_with(super::super::open::BEGINNING)
}
