//! The field whose zero set is the surface: the distance to the triangles, signed where they enclose a solid, minus the
//! requested distance.

use glam::DVec3;
use ravec_mesh::{Aabb, Bvh, Closest, ClosestOnTriangle, WindingNumbers, closest_on_triangle};
use ravec_progress::{Cancelled, Progress};

/// Factor by which the sum of the radii of two balls must exceed the distance of their centers, so that rounding cannot matter.
const OVERLAP: f64 = 1.0 + 1e-9;

/// Side of the triangles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Region {
    /// Not known yet: triangles may separate the points.
    Unknown,
    /// Outside the solid; all of space if the triangles are not taken as a solid.
    Outside,
    /// Inside the solid.
    Inside,
}

/// Interpretation of the triangles as a solid.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Solid {
    /// Not a solid: all of space is outside.
    No,
    /// Closed and oriented, so that rays count winding exactly.
    Closed,
    /// Any triangles, by their winding number.
    Any,
}

/// A point whose side is known, with its distance to the triangles.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Place {
    pub point: DVec3,
    pub distance: f64,
    pub region: Region,
}

impl Place {
    /// Distances are below zero inside.
    pub fn new(point: DVec3, signed_distance: f64) -> Self {
        Self {
            point,
            distance: signed_distance.abs(),
            region: if signed_distance < 0.0 {
                Region::Inside
            } else {
                Region::Outside
            },
        }
    }

    pub fn signed_distance(&self) -> f64 {
        if self.region == Region::Inside {
            -self.distance
        } else {
            self.distance
        }
    }
}

/// The point of the triangles closest to a query point.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Near {
    /// The closest triangle.
    pub triangle: u32,
    /// The closest point.
    pub point: DVec3,
    /// Unit vector from the closest point to the query point; zero on the triangles. If the surface consists of the triangles
    /// themselves, the normal of the closest one.
    pub away: DVec3,
    /// Distance to the closest point.
    pub distance: f64,
}

/// The distance to the triangles, and the level at which the surface lies.
pub(crate) struct Field<'a> {
    bvh: &'a Bvh,
    solid: Solid,
    /// Winding numbers, for [`Solid::Any`].
    winding: Option<WindingNumbers<'a>>,
    bounds: Aabb,
    /// Signed distance of the surface: negative inside the solid.
    pub level: f64,
    /// Facets may be far larger than the distance.
    pub has_large_facets: bool,
}

impl<'a> Field<'a> {
    /// Creates the field; distances inside the solid are negative.
    pub fn new(
        bvh: &'a Bvh,
        solid: Solid,
        level: f64,
        progress: &Progress,
    ) -> Result<Self, Cancelled> {
        let winding = match solid {
            Solid::No | Solid::Closed => None,
            Solid::Any => Some(WindingNumbers::try_new(bvh, progress)?),
        };
        Ok(Self {
            bvh,
            solid,
            winding,
            bounds: bvh.bounds(),
            level,
            has_large_facets: false,
        })
    }

    /// Distance of the surface from the triangles.
    pub fn radius(&self) -> f64 {
        self.level.abs()
    }

    /// Returns whether distances have a sign.
    pub fn is_signed(&self) -> bool {
        self.solid != Solid::No
    }

    /// Returns whether the triangles face away from the solid everywhere.
    pub fn is_oriented(&self) -> bool {
        self.solid == Solid::Closed
    }

    pub fn bvh(&self) -> &'a Bvh {
        self.bvh
    }

    /// Finds the closest point of the triangles to a finite point; `hint` is a triangle near it.
    #[inline]
    pub fn near(&self, p: DVec3, hint: u32) -> Near {
        let closest = self.bvh.closest_with_hint(p, hint);
        let Closest {
            triangle,
            point,
            distance_sq,
            ..
        } = closest.expect("the point is finite and there are triangles");
        Near {
            triangle,
            point,
            away: self.away(p, point, triangle),
            distance: distance_sq.sqrt(),
        }
    }

    /// As [`Self::near`] for a point whose closest triangle is known.
    #[inline]
    pub fn near_of(&self, p: DVec3, triangle: u32) -> Near {
        self.near_from(
            p,
            triangle,
            closest_on_triangle(p, self.bvh.corners(triangle)),
        )
    }

    /// Finds the closest point on some triangles; of equally close ones, the first.
    ///
    /// # Panics
    /// If the list is empty.
    #[inline]
    pub fn nearest_of(&self, p: DVec3, triangles: &[u32]) -> Near {
        let mut best: Option<(u32, ClosestOnTriangle)> = None;
        for (i, &triangle) in triangles.iter().enumerate() {
            if triangles[..i].contains(&triangle) {
                continue;
            }
            let closest = closest_on_triangle(p, self.bvh.corners(triangle));
            if best.is_none_or(|(_, best)| closest.distance_sq < best.distance_sq) {
                best = Some((triangle, closest));
            }
        }
        let (triangle, closest) = best.expect("there is a triangle");
        self.near_from(p, triangle, closest)
    }

    #[inline]
    fn near_from(&self, p: DVec3, triangle: u32, closest: ClosestOnTriangle) -> Near {
        Near {
            triangle,
            point: closest.point,
            away: self.away(p, closest.point, triangle),
            distance: closest.distance_sq.sqrt(),
        }
    }

    /// The unit normal of a triangle; zero if it has no area.
    #[inline]
    pub fn normal(&self, triangle: u32) -> DVec3 {
        let &[a, b, c] = self.bvh.corners(triangle);
        (b - a).cross(c - a).normalize_or_zero()
    }

    #[inline]
    fn away(&self, p: DVec3, closest: DVec3, triangle: u32) -> DVec3 {
        if self.level == 0.0 {
            self.normal(triangle)
        } else {
            (p - closest).normalize_or_zero()
        }
    }

    /// Projects `p` onto the surface over its closest point, which is exact unless another triangle is closer there.
    #[inline]
    pub fn foot(&self, p: DVec3, near: &Near) -> DVec3 {
        if self.level == 0.0 {
            near.point
        } else {
            p + (self.radius() - near.distance) * near.away
        }
    }

    /// Returns whether a point of a triangle is on the border of the solid, if the surface consists of the triangles
    /// themselves: parts of overlapping solids lie inside others.
    pub fn is_border(&self, p: DVec3, normal: DVec3, step: f64) -> bool {
        // the solid is below the point in any case
        self.level != 0.0 || self.region(p + step * normal) == Region::Outside
    }

    /// Returns the side of a point.
    pub fn region(&self, p: DVec3) -> Region {
        let is_inside = match &self.winding {
            Some(winding) => winding.is_inside(p),
            None => self.is_signed() && self.turns_around(p) > 0,
        };
        if is_inside {
            Region::Inside
        } else {
            Region::Outside
        }
    }

    /// Returns the side of a point at a known distance from the triangles, as [`Self::region`] does, but by the `known` places
    /// if they suffice: no triangle is in the ball around either point, so overlapping balls lie on one side.
    pub fn region_beside(&self, p: DVec3, distance: f64, known: &[Place]) -> Region {
        let overlaps =
            |place: &&Place| place.distance + distance > OVERLAP * place.point.distance(p);
        match known.iter().find(overlaps) {
            Some(place) => place.region,
            None => self.region(p),
        }
    }

    /// Returns the side of the segment between two places, if the places determine it.
    pub fn region_between(&self, [a, b]: &[Place; 2]) -> Region {
        let overlap = || a.distance + b.distance > OVERLAP * a.point.distance(b.point);
        if !self.is_signed() || (a.region == b.region && overlap()) {
            a.region
        } else {
            Region::Unknown
        }
    }

    /// Counts how often closed and oriented triangles wind around a point.
    fn turns_around(&self, p: DVec3) -> i32 {
        // along the axis with the shortest way out, slightly tilted to avoid edges
        let from_center = p - self.bounds.center();
        let left = 0.5 * self.bounds.size() - from_center.abs();
        let direction = if left.x <= left.y && left.x <= left.z {
            DVec3::new(1f64.copysign(from_center.x), 0.0123, 0.0271)
        } else if left.y <= left.z {
            DVec3::new(0.0271, 1f64.copysign(from_center.y), 0.0123)
        } else {
            DVec3::new(0.0123, 0.0271, 1f64.copysign(from_center.z))
        };
        self.bvh.ray_turns(p, direction)
    }

    /// Returns the side on which the surface lies.
    pub fn surface_region(&self) -> Region {
        if self.level < 0.0 {
            Region::Inside
        } else {
            Region::Outside
        }
    }

    /// Value of the field at a distance on a known side.
    #[inline]
    pub fn value(&self, distance: f64, region: Region) -> f64 {
        if region == Region::Inside {
            -distance - self.level
        } else {
            distance - self.level
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use ravec_mesh::TriMesh;
    use ravec_scenes::solids::cuboid;

    /// A cube with a cavity: the sides change twice.
    fn hollow() -> TriMesh {
        let (outer, inner) = (
            cuboid(DVec3::splat(2.0)).mesh,
            cuboid(DVec3::splat(1.2)).mesh,
        );
        let middle = |mesh: &TriMesh| mesh.bounds().center();
        let shift = middle(&outer) - middle(&inner);
        let count = outer.positions().len() as u32;
        let moved = inner.positions().iter().map(|&p| p + shift);
        let turned = inner.triangles().iter();
        let turned = turned.map(|&[a, b, c]| [a, c, b].map(|v| v + count));
        let positions = outer.positions().iter().copied().chain(moved).collect();
        let triangles = outer.triangles().iter().copied().chain(turned).collect();
        TriMesh::new(positions, triangles).unwrap()
    }

    fn place() -> impl Strategy<Value = DVec3> {
        [-1.5..1.5, -1.5..1.5, -1.5..1.5].prop_map(DVec3::from_array)
    }

    proptest! {
        #[test]
        fn the_side_that_follows_from_others_is_the_one_that_is_found(
            at in place(), others in prop::collection::vec(place(), 0..4), level in prop::sample::select(vec![0.0, 0.1, -0.1]),
            solid in prop::sample::select(vec![Solid::Closed, Solid::Any]),
        ) {
            let mesh = hollow();
            let bvh = Bvh::new(&mesh);
            let field = Field::new(&bvh, solid, level, &Progress::none()).unwrap();
            let middle = mesh.bounds().center();
            let place_at = |p: DVec3| {
                let distance = field.near(p, 0).distance;
                let signed = field.value(distance, field.region(p)) + level;
                Place::new(p, signed)
            };
            let known: Vec<Place> = others.iter().map(|&p| place_at(middle + p)).collect();
            let p = middle + at;
            let distance = field.near(p, 0).distance;
            prop_assert_eq!(field.region_beside(p, distance, &known), field.region(p));
            for place in known {
                prop_assert!((place.signed_distance().abs() - place.distance).abs() < 1e-15);
            }
        }
    }
}
