//! What a ray meets first, by walking down boxes from the index: nothing here reads or decodes.

use crate::{
    error::{Error, Result},
    index::Index,
    source::requests::plan,
};

/// A half-line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Where it begins, world units.
    pub origin: [f64; 3],
    /// Where it goes; of any length but 0.
    pub direction: [f64; 3],
}

impl Ray {
    /// The ray with a direction of length 1.
    ///
    /// # Errors
    /// [`Error::Query`] if it has no direction, or is not finite.
    pub(crate) fn unit(self) -> Result<Self> {
        let length = self.direction.iter().map(|x| x * x).sum::<f64>().sqrt();
        let direction = self.direction.map(|x| x / length);
        if !self.origin.iter().chain(&direction).all(|x| x.is_finite()) {
            return Err(Error::Query { what: "a ray has no direction, or is not finite".into() });
        }
        Ok(Self { direction, ..self })
    }

    /// How far along the ray a box begins, if it is met at all.
    pub(crate) fn enters(&self, [low, high]: [[f64; 3]; 2]) -> Option<f64> {
        let (mut first, mut last) = (0.0_f64, f64::INFINITY);
        for axis in 0..3 {
            let (origin, direction) = (self.origin[axis], self.direction[axis]);
            if direction == 0.0 {
                if origin < low[axis] || origin > high[axis] {
                    return None;
                }
                continue;
            }
            let [a, b] = [low[axis], high[axis]].map(|side| (side - origin) / direction);
            (first, last) = (first.max(a.min(b)), last.min(a.max(b)));
        }
        // Rounding may miss a box that is touched.
        (first <= last * (1.0 + 1e-12)).then_some(first)
    }
}

impl Index {
    /// The leaves whose boxes a ray meets, with the distance where it enters them, the nearest first. Roots that do not
    /// take part are left out with all below them.
    ///
    /// # Errors
    /// [`Error::Missing`], [`Error::Format`].
    pub(crate) fn leaves_along(&self, ray: &Ray, takes_part: impl Fn(u32) -> bool) -> Result<Vec<(f64, u32)>> {
        let (mut found, mut missing) = (vec![], vec![]);
        let mut waiting: Vec<u32> = self.tops_along(ray, &mut missing)?;
        while let Some(root) = waiting.pop() {
            if !takes_part(root) {
                continue;
            }
            let look = || {
                let Some(enters) = ray.enters(self.root_bounds(root)?) else { return Ok(None) };
                Ok(Some((enters, self.children(root)?)))
            };
            match look() {
                Ok(None) => {}
                Ok(Some((enters, children))) if children.is_empty() => found.push((enters, root)),
                Ok(Some((_, children))) => waiting.extend(children),
                Err(Error::Missing { ranges }) => missing.extend(ranges),
                Err(error) => return Err(error),
            }
        }
        if !missing.is_empty() {
            return Err(Error::Missing { ranges: plan(missing) });
        }
        found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        Ok(found)
    }

    /// The tops in clusters whose boxes a ray meets.
    fn tops_along(&self, ray: &Ray, missing: &mut Vec<std::ops::Range<u64>>) -> Result<Vec<u32>> {
        let mut tops = vec![];
        let mut root = 0;
        while root < self.top_count() {
            let cluster = match self.owner(root, |cluster| cluster.first_root).and_then(|owner| self.cluster(owner)) {
                Ok(cluster) => cluster,
                Err(Error::Missing { ranges }) => {
                    missing.extend(ranges);
                    return Ok(tops);
                }
                Err(error) => return Err(error),
            };
            let end = (cluster.first_root + cluster.root_count).min(self.top_count());
            if ray.enters(cluster.bounds.map(|point| self.lattice().world(point))).is_some() {
                tops.extend(root..end);
            }
            root = end.max(root + 1);
        }
        Ok(tops)
    }
}
