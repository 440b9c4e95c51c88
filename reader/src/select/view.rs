//! Views, and the volumes of space that queries ask for.
//!
//! The error of a node on the screen is its stored bound times a factor of its box and the view. A point p that is
//! drawn and the point q of the input that it stands for both lie in the box, at most the bound e apart. Seen through a
//! pinhole with f = viewport height / (2 tan(vertical field of view / 2)) pixels per unit of tangent, p is off by at
//! most f e sec(angle of p off the axis) / depth of q. So the **factor** is f s / d with d the least depth in the box
//! (not less than the near plane's: what lies before it is not seen) and s the largest secant: that of the viewport's
//! corner or, where that is less, largest distance in the box / d. Niski 2007, section 2.3, uses the distance to a
//! bounding sphere without s, which is no bound towards the picture's corners.
#![expect(clippy::disallowed_methods, reason = "views choose what is drawn; no decoded position depends on them")]

use crate::{
    codec::vector::{add, cross, dot, scale, sub},
    error::{Error, Result},
};

/// A plane; `normal` . x + `offset` >= 0 on its inner side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// Points inward; of length one where distances to it matter.
    pub normal: [f64; 3],
    /// World units where the normal has length one.
    pub offset: f64,
}

impl Plane {
    /// The largest value in a box.
    fn support(&self, [low, high]: [[f64; 3]; 2]) -> f64 {
        let pick = [0, 1, 2].map(|k| if self.normal[k] >= 0.0 { high[k] } else { low[k] });
        dot(self.normal, pick) + self.offset
    }
}

/// A part of space. A root is inside if its box meets it.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Volume {
    /// Smallest and largest coordinates.
    Box([[f64; 3]; 2]),
    /// A ball.
    Sphere {
        /// World units.
        centre: [f64; 3],
        /// World units, zero or more.
        radius: f64,
    },
    /// The inner side of six planes. A box near an edge of the frustum may count as inside although it lies outside.
    Frustum([Plane; 6]),
}

impl From<[[f64; 3]; 2]> for Volume {
    fn from(bounds: [[f64; 3]; 2]) -> Self {
        Self::Box(bounds)
    }
}

impl Volume {
    /// Whether a box meets the volume. In doubt the answer is true.
    pub fn meets(&self, [low, high]: [[f64; 3]; 2]) -> bool {
        match self {
            Self::Box([from, to]) => (0..3).all(|k| low[k] <= to[k] && from[k] <= high[k]),
            Self::Sphere { centre, radius } => {
                let nearest = [0, 1, 2].map(|k| centre[k].max(low[k]).min(high[k]));
                let offset = sub(nearest, *centre);
                dot(offset, offset) <= radius * radius
            }
            Self::Frustum(planes) => planes.iter().all(|plane| plane.support([low, high]) >= 0.0),
        }
    }

    /// # Errors
    /// [`Error::Query`] if the volume is empty or not finite.
    pub(crate) fn check(&self) -> Result<()> {
        let what = match self {
            Self::Box([low, high]) if !(0..3).all(|axis| low[axis] <= high[axis]) => {
                "the smallest corner of a volume has to come first"
            }
            Self::Sphere { centre, radius } if !(*radius >= 0.0 && centre.iter().all(|x| x.is_finite())) => {
                "a sphere needs a centre and a radius of zero or more"
            }
            Self::Frustum(planes)
                if !planes.iter().all(|p| p.offset.is_finite() && p.normal.iter().all(|x| x.is_finite())) =>
            {
                "the planes of a frustum have to be finite"
            }
            _ => return Ok(()),
        };
        Err(Error::Query { what: what.into() })
    }
}

/// A perspective view of the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// The camera's position, world units.
    pub position: [f64; 3],
    /// The direction in which it looks, of any length but zero.
    pub forward: [f64; 3],
    /// The direction that is up in the picture. It need not be perpendicular to `forward`.
    pub up: [f64; 3],
    /// Width and height in pixels.
    pub viewport: [u32; 2],
    /// Full angle between the picture's upper and lower border, radians, below pi.
    pub vertical_fov: f64,
    /// Depth of the near plane, world units, above zero.
    pub near: f64,
    /// The screen error to reach, pixels.
    pub pixel_tolerance: f64,
    /// The part of the viewport that is drawn: left and lower, right and upper border in 0 to 1.
    pub window: [[f64; 2]; 2],
}

impl Default for View {
    /// From the origin along the negative z axis: 60 degrees, 1920 x 1080, one pixel.
    fn default() -> Self {
        Self {
            position: [0.0; 3],
            forward: [0.0, 0.0, -1.0],
            up: [0.0, 1.0, 0.0],
            viewport: [1920, 1080],
            vertical_fov: std::f64::consts::FRAC_PI_3,
            near: 1e-3,
            pixel_tolerance: 1.0,
            window: [[0.0, 0.0], [1.0, 1.0]],
        }
    }
}

/// A box in any direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct OrientedBox {
    pub centre: [f64; 3],
    /// Of length one, and perpendicular.
    pub axes: [[f64; 3]; 3],
    /// Half of its length along each of them.
    pub half: [f64; 3],
}

impl OrientedBox {
    /// The largest product of its points with a direction.
    pub(crate) fn support(&self, direction: [f64; 3]) -> f64 {
        let out = self.axes.iter().zip(self.half).map(|(&axis, half)| dot(axis, direction).abs() * half);
        dot(self.centre, direction) + out.sum::<f64>()
    }

    /// Smallest and largest coordinates.
    pub(crate) fn bounds(&self) -> [[f64; 3]; 2] {
        let out = [0, 1, 2].map(|k| (0..3).map(|axis| self.axes[axis][k].abs() * self.half[axis]).sum::<f64>());
        [sub(self.centre, out), add(self.centre, out)]
    }

    /// Its eight corners.
    pub(crate) fn corners(&self) -> impl Iterator<Item = [f64; 3]> + '_ {
        let sign = |corner: usize, axis: usize| if corner >> axis & 1 == 0 { -1.0 } else { 1.0 };
        let out = move |corner: usize, axis: usize| scale(self.axes[axis], sign(corner, axis) * self.half[axis]);
        (0..8).map(move |corner| (0..3).fold(self.centre, |at, axis| add(at, out(corner, axis))))
    }
}

/// A view, prepared for projecting boxes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Projection {
    position: [f64; 3],
    /// Right, up, forward, of length one.
    axes: [[f64; 3]; 3],
    pixels_per_tangent: f64,
    near: f64,
    /// Secant of the angle between the axis and a corner of the whole viewport.
    corner_secant: f64,
    /// In the camera's axes: left, right, lower, upper, all through the camera.
    sides: [[f64; 3]; 4],
    planes: [Plane; 5],
}

/// How a view sees a box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Visibility {
    /// Pixels per world unit of error; 0 outside.
    pub factor: f64,
    /// Least depth, not less than the near plane's.
    pub depth: f64,
    /// How far the box may move before it is inside instead of outside or the reverse.
    pub margin: f64,
    /// No point of the box is farther from the camera.
    pub far: f64,
}

impl Projection {
    /// # Errors
    /// [`Error::Query`] if something in the view is not finite or makes no sense.
    pub(crate) fn new(view: &View) -> Result<Self> {
        let query = |what: &str| Error::Query { what: what.into() };
        let unit = |a: [f64; 3]| {
            let length = dot(a, a).sqrt();
            (length > 0.0 && length.is_finite()).then(|| scale(a, 1.0 / length))
        };
        let forward = unit(view.forward).ok_or_else(|| query("a view needs a direction"))?;
        let right = unit(cross(forward, view.up)).ok_or_else(|| query("a view's up must not be its direction"))?;
        let up = cross(right, forward);
        let tangent_y = (view.vertical_fov / 2.0).tan();
        let [width, height] = view.viewport.map(f64::from);
        if !(view.vertical_fov > 0.0 && view.vertical_fov < std::f64::consts::PI && width > 0.0 && height > 0.0) {
            return Err(query("a view needs pixels and a field of view between 0 and pi"));
        }
        if !(view.near > 0.0 && view.near.is_finite() && view.position.iter().all(|x| x.is_finite())) {
            return Err(query("a view needs a position and a near plane before the camera"));
        }
        let [[left, lower], [right_side, upper]] = view.window;
        if !(0.0 <= left && left < right_side && right_side <= 1.0 && 0.0 <= lower && lower < upper && upper <= 1.0) {
            return Err(query("a view's window has to be a part of its viewport"));
        }
        let tangent_x = tangent_y * width / height;
        let across = |at: f64, tangent: f64| (2.0 * at - 1.0) * tangent;
        let side = |normal: [f64; 3]| scale(normal, 1.0 / dot(normal, normal).sqrt());
        let sides = [
            side([1.0, 0.0, -across(left, tangent_x)]),
            side([-1.0, 0.0, across(right_side, tangent_x)]),
            side([0.0, 1.0, -across(lower, tangent_y)]),
            side([0.0, -1.0, across(upper, tangent_y)]),
        ];
        let axes = [right, up, forward];
        let world = |n: [f64; 3]| add(add(scale(right, n[0]), scale(up, n[1])), scale(forward, n[2]));
        let plane = |normal: [f64; 3], lift: f64| Plane { normal, offset: -dot(normal, view.position) - lift };
        let [a, b, c, d] = sides.map(world);
        let planes = [plane(a, 0.0), plane(b, 0.0), plane(c, 0.0), plane(d, 0.0), plane(forward, view.near)];
        Ok(Self {
            position: view.position,
            axes,
            pixels_per_tangent: height / (2.0 * tangent_y),
            near: view.near,
            corner_secant: (1.0 + tangent_x * tangent_x + tangent_y * tangent_y).sqrt(),
            sides,
            planes,
        })
    }

    /// Projects a box of any direction.
    pub(crate) fn look_at(&self, bounds: &OrientedBox) -> Visibility {
        let most = |plane: &Plane| bounds.support(plane.normal) + plane.offset;
        let margin = self.planes.iter().fold(f64::INFINITY, |least, plane| most(plane).min(least));
        let depth = -bounds.support(self.axes[2].map(|x| -x)) - dot(self.axes[2], self.position);
        let away = sub(bounds.centre, self.position);
        let far: f64 =
            bounds.axes.iter().zip(bounds.half).map(|(&axis, half)| (dot(axis, away).abs() + half).powi(2)).sum();
        self.visibility(margin, depth, far.sqrt())
    }

    fn visibility(&self, margin: f64, depth: f64, far: f64) -> Visibility {
        let depth = depth.max(self.near);
        let inside = margin >= 0.0;
        let secant = self.corner_secant.min((far / depth).max(1.0));
        // The last digits of all this are rounded.
        let factor = if inside { self.pixels_per_tangent * secant / depth * (1.0 + 1e-9) } else { 0.0 };
        Visibility { factor, depth, margin: margin.abs(), far }
    }

    /// The camera's position.
    pub(crate) fn position(&self) -> [f64; 3] {
        self.position
    }

    /// Projects a box.
    pub(crate) fn look(&self, bounds: [[f64; 3]; 2]) -> Visibility {
        let mut margin = f64::INFINITY;
        for plane in &self.planes {
            margin = margin.min(plane.support(bounds));
        }
        let forward = self.axes[2];
        let (mut depth, mut far) = (0.0, 0.0);
        for k in 0..3 {
            let (low, high) = (bounds[0][k] - self.position[k], bounds[1][k] - self.position[k]);
            depth += if forward[k] >= 0.0 { forward[k] * low } else { forward[k] * high };
            let most = low.abs().max(high.abs());
            far += most * most;
        }
        self.visibility(margin, depth, far.sqrt())
    }

    /// Whether a box lies between the sides of the window, so no other window of the same picture shows it.
    pub(crate) fn holds(&self, bounds: [[f64; 3]; 2]) -> bool {
        let least = |plane: &Plane| {
            let opposite = Plane { normal: plane.normal.map(|x| -x), offset: -plane.offset };
            -opposite.support(bounds)
        };
        self.planes[..4].iter().all(|plane| least(plane) > 0.0)
    }

    /// How far the picture has moved since `before`: by the first plus the second times its distance from the camera
    /// moves no point in the camera's axes, or in the axes of a side plane. Nothing where the two cannot be compared.
    pub(crate) fn motion_since(&self, before: &Self) -> Option<(f64, f64)> {
        let comparable = self.pixels_per_tangent == before.pixels_per_tangent
            && self.near == before.near
            && self.corner_secant == before.corner_secant;
        let difference =
            |a: &[[f64; 3]], b: &[[f64; 3]]| a.iter().zip(b).map(|(&a, &b)| square(sub(a, b))).sum::<f64>();
        // |(R1 - R0) x| is at most |x| times the spectral norm of R1 - R0, which has two equal singular values and a zero:
        // the Frobenius norm is larger by the square root of two.
        let turn = (difference(&self.axes, &before.axes) / 2.0).sqrt() * (1.0 + 1e-9);
        let sides = self.sides.iter().zip(&before.sides).map(|(&a, &b)| square(sub(a, b))).fold(0.0, f64::max).sqrt();
        comparable.then(|| (square(sub(self.position, before.position)).sqrt(), turn + sides))
    }
}

fn square(a: [f64; 3]) -> f64 {
    dot(a, a)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pixel position and depth of a point.
    fn project(view: &View, point: [f64; 3]) -> ([f64; 2], f64) {
        let projection = Projection::new(view).unwrap();
        let offset = sub(point, view.position);
        let [x, y, z] = projection.axes.map(|axis| dot(axis, offset));
        ([x / z, y / z].map(|t| t * projection.pixels_per_tangent), z)
    }

    fn numbers(seed: u64) -> impl FnMut() -> f64 {
        let mut state = seed | 1;
        move || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 11) as f64 / (1_u64 << 53) as f64
        }
    }

    fn random_view(next: &mut impl FnMut() -> f64) -> View {
        let direction = |next: &mut dyn FnMut() -> f64| [0; 3].map(|_: i32| next() - 0.5);
        let position = direction(next).map(|x| x * 4.0);
        View { position, forward: direction(next), up: direction(next), near: 0.05, ..View::default() }
    }

    #[test]
    fn no_seen_point_is_farther_off_than_the_factor_says() {
        let mut next = numbers(9);
        let mut seen = 0;
        for _ in 0..20_000 {
            let view = random_view(&mut next);
            let low = [0; 3].map(|_: i32| next() * 4.0 - 2.0);
            let size = [0; 3].map(|_: i32| next() * 0.5);
            let bounds = [low, add(low, size)];
            let visibility = Projection::new(&view).unwrap().look(bounds);
            let mut point = || [0, 1, 2].map(|k| low[k] + size[k] * next());
            let (p, q) = (point(), point());
            let ((at_p, depth_p), (at_q, depth_q)) = (project(&view, p), project(&view, q));
            let [half_width, half_height] = view.viewport.map(|x| f64::from(x) / 2.0);
            let visible = depth_p >= view.near && at_p[0].abs() <= half_width && at_p[1].abs() <= half_height;
            if !visible || depth_q < view.near {
                continue;
            }
            seen += 1;
            let error = square(sub(p, q)).sqrt();
            let off = ((at_p[0] - at_q[0]).powi(2) + (at_p[1] - at_q[1]).powi(2)).sqrt();
            assert!(visibility.factor > 0.0, "a box with a visible point is inside");
            assert!(off <= error * visibility.factor, "{off} pixels, {} promised", error * visibility.factor);
        }
        assert!(seen > 500, "{seen}");
    }

    #[test]
    fn no_box_changes_sides_before_its_margin_is_used_up() {
        let mut next = numbers(4);
        for _ in 0..5000 {
            let view = random_view(&mut next);
            let nudge = |x: [f64; 3], next: &mut dyn FnMut() -> f64| x.map(|x| x + (next() - 0.5) * 0.1);
            let moved = View {
                position: nudge(view.position, &mut next),
                forward: nudge(view.forward, &mut next),
                up: nudge(view.up, &mut next),
                window: [[next() * 0.1, 0.0], [1.0, 1.0]],
                ..view
            };
            let [before, after] = [&view, &moved].map(|view| Projection::new(view).unwrap());
            let low = [0; 3].map(|_: i32| next() * 4.0 - 2.0);
            let bounds = [low, add(low, [next() * 0.3; 3])];
            let (visibility, later) = (before.look(bounds), after.look(bounds));
            let (travel, turn) = after.motion_since(&before).unwrap();
            if travel + turn * visibility.far < visibility.margin {
                assert_eq!(visibility.factor > 0.0, later.factor > 0.0);
            }
        }
    }

    #[test]
    fn volumes_meet_what_they_touch() {
        let unit = [[0.0; 3], [1.0; 3]];
        assert!(Volume::from([[1.0; 3], [2.0; 3]]).meets(unit));
        assert!(!Volume::from([[1.1; 3], [2.0; 3]]).meets(unit));
        assert!(Volume::Sphere { centre: [2.0, 0.5, 0.5], radius: 1.0 }.meets(unit));
        assert!(!Volume::Sphere { centre: [2.0, 2.0, 0.5], radius: 1.0 }.meets(unit));
        let planes = [0, 1, 2, 3, 4, 5].map(|side| {
            let sign = if side % 2 == 0 { 1.0 } else { -1.0 };
            let mut normal = [0.0; 3];
            normal[side / 2] = sign;
            Plane { normal, offset: if side % 2 == 0 { -1.5 } else { 2.5 } }
        });
        assert!(!Volume::Frustum(planes).meets(unit));
        assert!(Volume::Frustum(planes).meets([[0.0; 3], [2.0; 3]]));
        assert!(Volume::Sphere { centre: [0.0; 3], radius: -1.0 }.check().is_err());
    }
}
