//! What materials have beside a base colour: normals, emitted light, occlusion, metals and roughness (glTF 2.0, section
//! 3.9).

use glam::DVec3;

use super::{Face, TexturedFace, Use};

/// The tangents of a triangle: where the first coordinate of its image grows, and where the second one, which counts
/// from above, becomes smaller.
fn tangents_of(face: &TexturedFace, [a, b, c]: &[DVec3; 3], smooth: DVec3) -> Option<[DVec3; 2]> {
    let side = |i: usize| [face.uv[i][0] - face.uv[0][0], face.uv[i][1] - face.uv[0][1]];
    let ([x, y], [z, w]) = (side(1), side(2));
    let turn = (x * w - y * z).signum();
    let right = ((b - a) * w - (c - a) * y) * turn;
    let up = ((b - a) * z - (c - a) * x) * turn;
    let right = (right - smooth * right.dot(smooth)).try_normalize()?;
    let up = (up - smooth * up.dot(smooth) - right * up.dot(right)).try_normalize()?;
    Some([right, up])
}

impl Face<'_> {
    /// The direction of the normal: that of the triangle, or of the input's own normals, turned by the material's image
    /// of them.
    pub fn normal(&self, weights: [f32; 3], footprint: f32) -> [f32; 3] {
        let smooth = self.smooth_normal(weights);
        let texture = self.textures[Use::Normal as usize].as_ref();
        let scale =
            self.material.and_then(|material| material.normal_texture.as_ref()).map_or(1.0, |(_, scale)| *scale);
        let has_object_normals = self.material.is_some_and(|material| material.has_object_normals);
        let turned = texture.and_then(|face| {
            let [first, second, third, _] = face.sample(weights, footprint).map(|share| f64::from(2.0 * share - 1.0));
            if has_object_normals {
                return DVec3::new(first, second, third).try_normalize();
            }
            let [right, up] =
                self.own_tangents(smooth, weights).or_else(|| tangents_of(face, &self.corners, smooth))?;
            let scale = f64::from(scale);
            (right * (first * scale) + up * (second * scale) + smooth * third).try_normalize()
        });
        turned.unwrap_or(smooth).as_vec3().to_array()
    }

    /// The input's own tangents: to the right of the image of normals, and to its top.
    fn own_tangents(&self, smooth: DVec3, weights: [f32; 3]) -> Option<[DVec3; 2]> {
        let place = self.appearance.layout.tangent?;
        let (mut right, mut side) = (DVec3::ZERO, 0.0);
        for (record, weight) in self.records.iter().zip(weights) {
            let [x, y, z, of_corner] = *record.get(place..place + 4)? else { return None };
            right += f64::from(weight) * DVec3::new(x.into(), y.into(), z.into());
            side += weight * of_corner;
        }
        let right = (right - smooth * right.dot(smooth)).try_normalize()?;
        if side == 0.0 || side.is_nan() { None } else { Some([right, smooth.cross(right) * f64::from(side.signum())]) }
    }

    /// The input's own normal, or that of the triangle.
    fn smooth_normal(&self, weights: [f32; 3]) -> DVec3 {
        let own = self.appearance.layout.normal.and_then(|place| {
            let of = |record: &&[f32]| {
                let [x, y, z] = *record.get(place..place + 3)? else { return None };
                DVec3::new(x.into(), y.into(), z.into()).try_normalize()
            };
            let normals = [of(&self.records[0])?, of(&self.records[1])?, of(&self.records[2])?];
            (0..3).map(|k| normals[k] * f64::from(weights[k])).sum::<DVec3>().try_normalize()
        });
        let [a, b, c] = self.corners;
        own.unwrap_or_else(|| (b - a).cross(c - a).normalize_or(DVec3::Z))
    }

    /// Light that it emits, linear; 1 is as bright as white paper.
    pub fn emissive(&self, weights: [f32; 3], footprint: f32) -> [f32; 3] {
        let [red, green, blue] = self.material.map_or([0.0; 3], |material| material.emissive);
        let texture = self.textures[Use::Emissive as usize].as_ref();
        let texel = texture.map_or([1.0; 4], |face| face.sample(weights, footprint));
        [red * texel[0], green * texel[1], blue * texel[2]]
    }

    /// Which share of the light from all around comes there.
    pub fn occlusion(&self, weights: [f32; 3], footprint: f32) -> f32 {
        let strength = self
            .material
            .and_then(|material| material.occlusion_texture.as_ref())
            .map_or(1.0, |(_, strength)| *strength);
        let texture = self.textures[Use::Occlusion as usize].as_ref();
        texture.map_or(1.0, |face| 1.0 + strength * (face.sample(weights, footprint)[0] - 1.0))
    }

    /// Metallic and roughness.
    pub fn metallic_roughness(&self, weights: [f32; 3], footprint: f32) -> [f32; 2] {
        let [metallic, roughness] =
            self.material.map_or([0.0, 1.0], |material| [material.metallic, material.roughness]);
        let texture = self.textures[Use::MetallicRoughness as usize].as_ref();
        let texel = texture.map_or([1.0; 4], |face| face.sample(weights, footprint));
        let own =
            |which: Use| self.textures[which as usize].as_ref().map_or(1.0, |face| face.sample(weights, footprint)[0]);
        [metallic * texel[2] * own(Use::Metallic), roughness * texel[1] * own(Use::Roughness)]
    }
}
