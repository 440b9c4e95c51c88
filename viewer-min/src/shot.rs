//! What is drawn of a scene from a view, and how long that takes.

use std::{sync::Arc, time::Instant};

use anyhow::Result;
use lodpack::{
    Index, Lattice, Mesh, View,
    stream::{DrawnRoot, Lit, Picture as Surfaces},
};

use crate::{
    args::Overlay,
    camera::vertices,
    draw::{Renderer, Shown, Turn},
    gpu::Targets,
    report::{Report, milliseconds},
    scene::{Beside, Scene},
    surface::Surface,
};

/// What a renderer has to know of a scene to draw it from a view, also on another thread.
pub(crate) struct Shot<'s> {
    pub view: View,
    overlays: &'s [Overlay],
    level_count: usize,
    index: Option<Arc<Index>>,
    lattice: Lattice,
    shown: Option<Shown>,
    surfaces: Drawn<'s>,
}

/// What is drawn of a scene.
#[derive(Clone, Copy)]
enum Drawn<'s> {
    /// The small mesh, and whether it is shaded smoothly.
    Overview(&'s Mesh, bool),
    Picture(&'s Surfaces),
}

impl<'s> Shot<'s> {
    /// Of one surface.
    pub fn of(surface: &'s Surface, view: View, overlays: &'s [Overlay], is_unlit: bool) -> Self {
        let shown = surface.channel.as_ref().map(|channel| Shown {
            number: channel.number,
            appearance: channel.appearance,
            is_unlit,
        });
        Self {
            view,
            overlays,
            level_count: surface.level_count(),
            index: surface.mesh().ok().map(|mesh| Arc::clone(mesh.file.index())),
            lattice: surface.lattice(),
            shown,
            surfaces: match surface.overview() {
                Some(mesh) => Drawn::Overview(mesh, surface.has_light),
                None => Drawn::Picture(surface.picture()),
            },
        }
    }

    /// Seen through a part of the picture.
    pub fn through(&self, window: [[f64; 2]; 2]) -> Self {
        Self { view: View { window, ..self.view }, index: self.index.clone(), ..*self }
    }

    /// The roots that are drawn; none where the overview is.
    pub fn roots(&self) -> impl Iterator<Item = &'s DrawnRoot> {
        let picture = match self.surfaces {
            Drawn::Overview(..) => None,
            Drawn::Picture(picture) => Some(picture),
        };
        picture.into_iter().flat_map(Surfaces::roots)
    }
}

impl Renderer {
    /// Uploads and hands over the current surfaces of all that a scene has, and adds times and bytes to a report.
    pub fn draw_scene(
        &mut self,
        targets: &Targets,
        scene: &Scene,
        (view, overlays, is_unlit): (&View, &[Overlay], bool),
        report: &mut Report,
    ) -> Result<()> {
        let count = scene.beside().len();
        while self.beside.len() < count {
            self.beside.push(Self::new(&self.gpu, self.way));
        }
        self.beside.truncate(count);
        let first = if count == 0 { Turn::Only } else { Turn::First };
        self.draw_shot(targets, &Shot::of(&scene.first, *view, overlays, is_unlit), first, report)?;
        for (number, (renderer, Beside { surface, frame })) in (1..).zip(self.beside.iter_mut().zip(scene.beside())) {
            renderer.images_per_frame = self.images_per_frame;
            let shot = Shot::of(surface, frame.view_of_ground(view), overlays, is_unlit);
            let turn = if number == count { Turn::Last } else { Turn::Next };
            let drawn = renderer.draw_shot(targets, &shot, turn, report);
            self.problems.extend(renderer.take_problems());
            drawn?;
        }
        Ok(())
    }

    /// Uploads and hands over what a shot shows.
    pub(crate) fn draw_shot(
        &mut self,
        targets: &Targets,
        shot: &Shot<'_>,
        turn: Turn,
        report: &mut Report,
    ) -> Result<()> {
        let (begun, uploaded_before) = (Instant::now(), self.gpu.uploaded());
        (self.overlays, self.level_count) = (shot.overlays.to_vec(), shot.level_count);
        self.index = shot.index.clone();
        self.lattice = shot.lattice;
        self.show(shot.shown);
        match shot.surfaces {
            Drawn::Overview(mesh, true) => {
                let Lit { positions, triangles, normals } = Lit::of(mesh);
                self.set_vertices(&vertices(&positions, &normals), &triangles);
            }
            Drawn::Overview(mesh, false) => self.set_mesh(&mesh.positions, &mesh.triangles),
            Drawn::Picture(picture) => self.update(picture),
        }
        report.upload_ms += milliseconds(begun.elapsed());
        let begun = Instant::now();
        self.draw_in_turn(targets, &shot.view, turn);
        let waited = milliseconds(self.gpu.take_waited());
        report.record_ms += milliseconds(begun.elapsed()) - waited;
        report.wait_ms += waited;
        report.uploaded += self.gpu.uploaded() - uploaded_before;
        self.gpu.check()
    }
}
