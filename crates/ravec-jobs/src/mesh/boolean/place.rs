//! Meshes of a Boolean operation that are moved, turned and scaled before they are combined.

use super::named::is_name;
use crate::error::JobError;
use glam::{DAffine3, DMat3, DVec3};
use ravec::mesh::{Aabb, TriMesh};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// Place of a mesh: `NAME:tx,ty,tz[,rx,ry,rz[,s]]`.
///
/// A mesh is scaled by `s` about the center of the box around its triangles, then turned about that center by `rx` degrees about
/// the x axis, `ry` about the y axis and `rz` about the z axis, in this order, about axes that stay where they are, counter-clockwise
/// seen from the tip of the axis; then it is shifted by `tx`, `ty`, `tz`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Placement {
    /// Name of the mesh in the expression.
    pub name: String,
    /// Shift, in units of the result, which are those of the first mesh.
    pub shift: [f64; 3],
    /// Turns about x, then y, then z, in degrees (default 0).
    pub turn_deg: [f64; 3],
    /// Scale, above 0 (default 1).
    pub scale: f64,
}

impl Placement {
    /// The place that a mesh has in its file.
    pub fn new(name: impl Into<String>) -> Self {
        Self {
            name: name.into(),
            shift: [0.0; 3],
            turn_deg: [0.0; 3],
            scale: 1.0,
        }
    }

    /// True if the mesh stays as it is in its file.
    pub fn is_identity(&self) -> bool {
        self.shift == [0.0; 3] && self.is_shift()
    }

    /// True if the mesh is neither turned nor scaled.
    fn is_shift(&self) -> bool {
        self.turn_deg == [0.0; 3] && self.scale == 1.0
    }

    /// The turn. Quarter turns are exact.
    pub fn turn(&self) -> DMat3 {
        let [x, y, z] = self.turn_deg.map(sin_cos_deg);
        let about_x = DMat3::from_cols(
            DVec3::X,
            DVec3::new(0.0, x[1], x[0]),
            DVec3::new(0.0, -x[0], x[1]),
        );
        let about_y = DMat3::from_cols(
            DVec3::new(y[1], 0.0, -y[0]),
            DVec3::Y,
            DVec3::new(y[0], 0.0, y[1]),
        );
        let about_z = DMat3::from_cols(
            DVec3::new(z[1], z[0], 0.0),
            DVec3::new(-z[0], z[1], 0.0),
            DVec3::Z,
        );
        about_z * about_y * about_x
    }

    /// The same place with the turns that together make a rotation; the turn about y is within 90 degrees.
    #[must_use]
    pub fn with_turn(self, turn: DMat3) -> Self {
        let [x, y, z] = [turn.x_axis, turn.y_axis, turn.z_axis];
        let sine = -x.z;
        let about_y = sine.clamp(-1.0, 1.0).asin();
        // at a quarter turn about y, turns about x and z are the same: all of it becomes one about z
        let (about_x, about_z) = if sine.abs() < 1.0 - 1e-12 {
            (y.z.atan2(z.z), x.y.atan2(x.x))
        } else {
            (0.0, (-y.x).atan2(y.y))
        };
        Self {
            turn_deg: [about_x, about_y, about_z].map(f64::to_degrees),
            ..self
        }
    }

    /// The map from points of the mesh to their place, for a mesh whose triangles are in this box.
    pub fn affine(&self, bounds: Aabb) -> DAffine3 {
        let shift = DVec3::from(self.shift);
        if self.is_shift() || bounds.is_empty() {
            return DAffine3::from_translation(shift);
        }
        let linear = self.turn() * self.scale;
        let center = bounds.center();
        DAffine3::from_mat3_translation(linear, center + shift - linear * center)
    }

    /// The mesh at its place.
    ///
    /// # Errors
    /// [`JobError::Parameter`] if a coordinate is not finite any more.
    pub fn place(&self, mesh: TriMesh) -> Result<TriMesh, JobError> {
        if self.is_identity() {
            return Ok(mesh);
        }
        let affine = self.affine(mesh.bounds());
        let (mut positions, triangles) = mesh.into_parts();
        for position in &mut positions {
            *position = affine.transform_point3(*position);
        }
        TriMesh::new(positions, triangles)
            .map_err(|_| self.wrong("small enough for coordinates to stay finite"))
    }

    fn wrong(&self, range: &'static str) -> JobError {
        JobError::Parameter {
            field: "places",
            value: self.to_string(),
            range,
        }
    }
}

/// Sine and cosine of an angle in degrees, exact for quarter turns.
fn sin_cos_deg(degrees: f64) -> [f64; 2] {
    let turned = degrees.rem_euclid(360.0);
    if turned == 0.0 {
        [0.0, 1.0]
    } else if turned == 90.0 {
        [1.0, 0.0]
    } else if turned == 180.0 {
        [0.0, -1.0]
    } else if turned == 270.0 {
        [-1.0, 0.0]
    } else {
        turned.to_radians().sin_cos().into()
    }
}

/// The place of each of the meshes with these names, where one is given.
pub(super) fn placements<'a>(
    given: &'a [Placement],
    names: &[String],
) -> Result<Vec<Option<&'a Placement>>, JobError> {
    let mut places = vec![None; names.len()];
    for placement in given {
        let Some(index) = names.iter().position(|name| *name == placement.name) else {
            return Err(placement.wrong("the place of a mesh that has this name"));
        };
        if places[index].replace(placement).is_some() {
            return Err(placement.wrong("the only place of the mesh"));
        }
    }
    Ok(places)
}

impl FromStr for Placement {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = |reason: &str| {
            format!(
                "`{text}` {reason}: write NAME:tx,ty,tz, NAME:tx,ty,tz,rx,ry,rz or NAME:tx,ty,tz,rx,ry,rz,s, as in drill:0,0,2.5,90,0,0"
            )
        };
        let (name, numbers) = text
            .split_once(':')
            .filter(|(name, _)| is_name(name.trim()))
            .ok_or_else(|| wrong("does not begin with the name of a mesh"))?;
        let numbers = numbers
            .split(',')
            .map(|number| number.trim().parse::<f64>());
        let numbers: Vec<f64> = numbers
            .collect::<Result<_, _>>()
            .map_err(|_| wrong("has something that is no number"))?;
        if numbers.iter().any(|number| !number.is_finite()) {
            return Err(wrong("has a number that is not finite"));
        }
        let mut placement = Self::new(name.trim());
        match numbers[..] {
            [x, y, z] => placement.shift = [x, y, z],
            [x, y, z, rx, ry, rz] => {
                placement.shift = [x, y, z];
                placement.turn_deg = [rx, ry, rz];
            }
            [x, y, z, rx, ry, rz, scale] => {
                placement.shift = [x, y, z];
                placement.turn_deg = [rx, ry, rz];
                placement.scale = scale;
            }
            _ => return Err(wrong("has not three, six or seven numbers")),
        }
        if placement.scale <= 0.0 {
            return Err(wrong("has a scale that is not above 0"));
        }
        Ok(placement)
    }
}

impl fmt::Display for Placement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y, z] = self.shift;
        write!(f, "{}:{x},{y},{z}", self.name)?;
        if !self.is_shift() {
            let [x, y, z] = self.turn_deg;
            write!(f, ",{x},{y},{z}")?;
        }
        if self.scale != 1.0 {
            write!(f, ",{}", self.scale)?;
        }
        Ok(())
    }
}

impl TryFrom<String> for Placement {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<Placement> for String {
    fn from(placement: Placement) -> Self {
        placement.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn place(text: &str) -> Placement {
        text.parse().unwrap()
    }

    #[test]
    fn places_come_back_as_they_were_written() {
        for (text, canonical) in [
            ("b:1,-2.5,0", "b:1,-2.5,0"),
            ("größe_2:0,0,0,90,0,-7.25", "größe_2:0,0,0,90,0,-7.25"),
            ("b: 0, 0, 0, 0, 0, 0, 1e-3", "b:0,0,0,0,0,0,0.001"),
            ("b:1,2,3,0,0,0,1", "b:1,2,3"),
        ] {
            assert_eq!(place(text).to_string(), canonical);
            assert_eq!(place(canonical), place(text));
        }
        let json = serde_json::to_value(place("b:1,2,3")).unwrap();
        assert_eq!(json, "b:1,2,3");
    }

    #[test]
    fn what_is_no_place_is_refused_in_a_sentence() {
        for (text, reason) in [
            ("1,2,3", "name"),
            (":1,2,3", "name"),
            ("a-b:1,2,3", "name"),
            ("b:1,2", "three, six or seven"),
            ("b:1,2,3,4", "three, six or seven"),
            ("b:1,2,x", "no number"),
            ("b:1,2,", "no number"),
            ("b:1,2,inf", "finite"),
            ("b:1,2,3,0,0,0,0", "above 0"),
            ("b:1,2,3,0,0,0,-1", "above 0"),
        ] {
            let error = text.parse::<Placement>().unwrap_err();
            assert!(
                error.contains(reason) && error.contains("write NAME:"),
                "{error}"
            );
        }
    }

    #[test]
    fn a_mesh_is_turned_about_x_then_y_then_z_about_its_center() {
        let bounds = Aabb::new(DVec3::new(1.0, 1.0, 1.0), DVec3::new(3.0, 3.0, 3.0));
        let affine = place("b:10,20,30,90,90,0").affine(bounds);
        // y becomes z by the turn about x, and this becomes x by the turn about y
        let found = affine.transform_point3(DVec3::new(2.0, 3.0, 2.0));
        assert_eq!(found, DVec3::new(13.0, 22.0, 32.0));
        let scaled = place("b:0,0,0,0,0,90,3").affine(bounds);
        let found = scaled.transform_point3(DVec3::new(3.0, 2.0, 1.0));
        assert_eq!(found, DVec3::new(2.0, 5.0, -1.0));
    }

    #[test]
    fn a_rotation_has_turns_that_make_it() {
        for text in [
            "b:0,0,0,10,20,30",
            "b:0,0,0,-170,80,-95",
            "b:0,0,0,25,90,40",
            "b:0,0,0,25,-90,40",
            "b:0,0,0,0,0,180",
        ] {
            let turn = place(text).turn();
            let again = Placement::new("b").with_turn(turn).turn();
            assert!((turn - again).abs_diff_eq(DMat3::ZERO, 1e-9), "{text}");
        }
    }

    #[test]
    fn a_shift_is_exact_far_from_the_origin() {
        let bounds = Aabb::new(DVec3::splat(1e9), DVec3::splat(1e9 + 0.3));
        let affine = place("b:0.1,0,0").affine(bounds);
        assert_eq!(
            affine.transform_point3(DVec3::splat(0.7)),
            DVec3::new(0.7 + 0.1, 0.7, 0.7)
        );
    }
}
