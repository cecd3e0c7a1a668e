//! The meshes of a Boolean as they are read, for handles, ghosts and clicks. All of it runs beside the window.

use crate::content::Content;
use crate::document::EditId;
use crate::view::mesh::ShownMesh;
use glam::{DAffine3, DVec3};
use ravec::mesh::{Aabb, Adjacency, Bvh, TriMesh};
use ravec::mesh_io::{LengthUnit, UnitRatio};
use ravec::mesh_render::Sight;
use ravec::progress::Progress;
use ravec_jobs::Context;
use ravec_jobs::mesh::boolean::{Placement, unit_scale};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};
use std::time::SystemTime;

/// Lines by which a part is highlighted: more would be felt while the view turns.
const MAX_LINES: usize = 1500;

/// Edges are lines where normals differ by more, as the cosine of 30 degrees.
const CREASE: f64 = 0.866;

/// A mesh as it is in its file.
pub(super) struct Part {
    mesh: Arc<TriMesh>,
    bounds: Aabb,
    lines: Vec<[DVec3; 2]>,
    unit: Option<LengthUnit>,
    tree: OnceLock<Bvh>,
}

impl Part {
    fn new(mesh: Arc<TriMesh>, unit: Option<LengthUnit>) -> Self {
        Self {
            bounds: mesh.bounds(),
            lines: lines(&mesh),
            mesh,
            unit,
            tree: OnceLock::new(),
        }
    }
}

/// Borders and creases, the longest if there are many.
fn lines(mesh: &TriMesh) -> Vec<[DVec3; 2]> {
    let adjacency = Adjacency::new(mesh);
    let normal = |triangle: u32| {
        let [a, b, c] = mesh.corners(triangle);
        (b - a).cross(c - a).normalize_or_zero()
    };
    let edges = adjacency.edges().iter().enumerate();
    let creases = edges.filter(|(edge, _)| match adjacency.uses(*edge as u32) {
        [a, b] => normal(a.triangle).dot(normal(b.triangle)) < CREASE,
        _ => true,
    });
    let ends = creases.map(|(_, ends)| ends.map(|vertex| mesh.positions()[vertex as usize]));
    let mut lines: Vec<[DVec3; 2]> = ends.collect();
    if lines.len() > MAX_LINES {
        lines.sort_by(|a, b| b[0].distance(b[1]).total_cmp(&a[0].distance(a[1])));
        lines.truncate(MAX_LINES);
    }
    lines
}

/// A mesh of the expression.
#[derive(Clone)]
pub(super) struct NamedPart {
    pub name: String,
    /// The mesh, or why it cannot be read.
    pub part: Result<Arc<Part>, String>,
    /// Scale to the unit of the first mesh.
    scale: f64,
}

impl NamedPart {
    /// The map from the points of the file to their place.
    fn affine(&self, part: &Part, placement: &Placement) -> DAffine3 {
        let Aabb { min, max } = part.bounds;
        let scaled = Aabb::new(min * self.scale, max * self.scale);
        let scale = DAffine3::from_scale(DVec3::splat(self.scale));
        if part.bounds.is_empty() {
            return scale;
        }
        placement.affine(scaled) * scale
    }

    /// The middle of the part at its place.
    pub fn center(&self, placement: &Placement) -> Option<DVec3> {
        let part = self.part.as_ref().ok()?;
        let affine = self.affine(part, placement);
        (!part.bounds.is_empty()).then(|| affine.transform_point3(part.bounds.center()))
    }

    /// The edges of the box around the part, and its creases, at its place.
    pub fn outline(&self, placement: &Placement) -> Vec<[DVec3; 2]> {
        let Ok(part) = &self.part else {
            return Vec::new();
        };
        let ends = [part.bounds.min, part.bounds.max];
        let corner = |k: usize| DVec3::new(ends[k & 1].x, ends[k >> 1 & 1].y, ends[k >> 2].z);
        let edges = (0..8usize).flat_map(|k| {
            let others = [1, 2, 4].into_iter().filter(move |bit| k & bit == 0);
            others.map(move |bit| [k, k | bit])
        });
        let edges = edges.map(|edge| edge.map(corner));
        let edges = edges.filter(|_| !part.bounds.is_empty());
        let affine = self.affine(part, placement);
        let all = edges.chain(part.lines.iter().copied());
        all.map(|line| line.map(|point| affine.transform_point3(point)))
            .collect()
    }

    /// Diagonal of the box around the part, in the unit of the first mesh.
    pub fn diagonal(&self) -> f64 {
        let part = self.part.as_ref().ok();
        part.map_or(0.0, |part| self.scale * part.bounds.diagonal())
    }
}

/// The meshes of an edit.
pub(super) struct Scene {
    pub job: SceneJob,
    pub parts: Vec<NamedPart>,
}

/// Parts of a scene.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct SceneJob {
    pub edit: EditId,
    /// Name of the input of the edit, and its key.
    pub input: (String, Arc<str>),
    /// Names and files of the other meshes.
    pub files: Vec<(String, PathBuf)>,
    /// The unit of all meshes, if it is set.
    pub unit: Option<LengthUnit>,
    /// The names of the meshes that the expression uses.
    pub used: Vec<String>,
}

/// A file at a time.
type Version = (PathBuf, u64, Option<SystemTime>);

/// Meshes that were read.
#[derive(Default)]
pub(super) struct Library {
    input: Option<(Arc<str>, Arc<Part>)>,
    files: HashMap<Version, Arc<Part>>,
}

impl Library {
    /// Reads what is not known yet; `None` if cancelled.
    pub fn scene(
        &mut self,
        job: &SceneJob,
        input: Option<&Content>,
        progress: &Progress,
    ) -> Option<Scene> {
        let mut parts = Vec::new();
        let (name, key) = &job.input;
        if let Some(mesh) = input.and_then(Content::mesh) {
            let known = self.input.take().filter(|(of, _)| of == key);
            let (_, part) = self.input.insert(known.unwrap_or_else(|| {
                let part = Part::new(Arc::new(mesh.mesh.clone()), mesh.unit);
                (key.clone(), Arc::new(part))
            }));
            parts.push((name.clone(), Ok(part.clone())));
        }
        let mut kept = HashMap::new();
        for (name, path) in &job.files {
            let part = match version(path) {
                Ok(version) => {
                    let known = self.files.get(&version).cloned();
                    let part = known.map_or_else(|| read(path, progress).map(Arc::new), Ok);
                    if let Ok(part) = &part {
                        kept.insert(version, part.clone());
                    }
                    part
                }
                Err(error) => Err(format!("{}: {error}", path.display())),
            };
            if progress.is_cancelled() {
                return None;
            }
            parts.push((name.clone(), part));
        }
        self.files = kept;
        let unit_of = |part: &Part| job.unit.or(part.unit);
        let first = parts.iter().find(|(name, _)| job.used.contains(name));
        let first = first.and_then(|(_, part)| unit_of(part.as_ref().ok()?));
        let named = parts.into_iter().map(|(name, part)| {
            let scale = part
                .as_ref()
                .ok()
                .and_then(|part| unit_scale(unit_of(part), first));
            NamedPart {
                name,
                part,
                scale: scale.map_or(1.0, UnitRatio::factor),
            }
        });
        Some(Scene {
            job: job.clone(),
            parts: named.collect(),
        })
    }
}

fn version(path: &Path) -> std::io::Result<Version> {
    let facts = std::fs::metadata(path)?;
    Ok((path.to_path_buf(), facts.len(), facts.modified().ok()))
}

fn read(path: &Path, progress: &Progress) -> Result<Part, String> {
    let limits = Context::new(progress).mesh_limits();
    let file = ravec_jobs::mesh::read_mesh_file(path, &limits, progress);
    let file = file.map_err(|error| error.to_string())?;
    Ok(Part::new(Arc::new(file.mesh), file.unit))
}

/// All parts at their places, as one mesh to be drawn.
pub(super) struct Ghost {
    pub edit: EditId,
    pub mesh: Arc<ShownMesh>,
}

impl Ghost {
    /// The parts that can be read; `None` if there are none, or their coordinates are beyond all numbers.
    pub fn new(scene: &Scene, placements: &[Placement]) -> Option<Self> {
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        for named in &scene.parts {
            let Ok(part) = &named.part else {
                continue;
            };
            let affine = named.affine(part, &placement_of(placements, &named.name));
            let offset = u32::try_from(positions.len()).ok()?;
            let moved = part.mesh.positions().iter();
            positions.extend(moved.map(|&point| affine.transform_point3(point)));
            let shifted = part.mesh.triangles().iter();
            triangles.extend(shifted.map(|corners| corners.map(|vertex| vertex + offset)));
        }
        let mesh = TriMesh::new(positions, triangles).ok()?;
        (!mesh.triangles().is_empty()).then(|| Self {
            edit: scene.job.edit,
            mesh: Arc::new(ShownMesh::new(Arc::new(mesh))),
        })
    }
}

/// The place of the part with a name.
pub(super) fn placement_of(placements: &[Placement], name: &str) -> Placement {
    let given = placements
        .iter()
        .find(|placement| placement.name == name)
        .cloned();
    given.unwrap_or_else(|| Placement::new(name))
}

/// The part that a line of sight meets first.
pub(super) fn hit(scene: &Scene, placements: &[Placement], sight: Sight) -> Option<String> {
    let mut nearest: Option<(f64, &str)> = None;
    for named in &scene.parts {
        let Ok(part) = &named.part else {
            continue;
        };
        let placement = placement_of(placements, &named.name);
        let inverse = named.affine(part, &placement).inverse();
        let tree = part.tree.get_or_init(|| Bvh::new(&part.mesh));
        let origin = inverse.transform_point3(sight.origin);
        let hits = tree.ray_hits(origin, inverse.transform_vector3(sight.direction));
        if let Some(hit) = hits.first()
            && nearest.is_none_or(|(t, _)| hit.t < t)
        {
            nearest = Some((hit.t, &named.name));
        }
    }
    nearest.map(|(_, name)| name.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec_scenes::solids::cuboid;

    fn named(name: &str, size: f64, unit: Option<LengthUnit>) -> NamedPart {
        let mesh = cuboid(DVec3::splat(size)).mesh;
        NamedPart {
            name: name.to_owned(),
            part: Ok(Arc::new(Part::new(Arc::new(mesh), unit))),
            scale: 1.0,
        }
    }

    fn job(path: Option<PathBuf>) -> SceneJob {
        SceneJob {
            edit: 1,
            input: ("a".to_owned(), "key".into()),
            files: path
                .map(|path| ("b".to_owned(), path))
                .into_iter()
                .collect(),
            unit: None,
            used: vec!["a".to_owned(), "b".to_owned()],
        }
    }

    fn scene() -> Scene {
        Scene {
            job: job(None),
            parts: vec![named("a", 2.0, None), named("b", 2.0, None)],
        }
    }

    #[test]
    fn the_nearest_part_is_hit_where_it_was_moved_to() {
        let scene = scene();
        let down = |x: f64| Sight {
            origin: DVec3::new(x, 0.25, 50.0),
            direction: -DVec3::Z,
        };
        let places: Vec<Placement> = vec!["b:1.5,0,1,0,0,45,0.5".parse().unwrap()];
        for (x, expected) in [(-0.5, Some("a")), (1.5, Some("b")), (3.0, None)] {
            assert_eq!(hit(&scene, &places, down(x)).as_deref(), expected);
        }
    }

    #[test]
    fn a_ghost_has_all_parts_at_their_places() {
        let places: Vec<Placement> = vec!["b:10,0,0".parse().unwrap()];
        let ghost = Ghost::new(&scene(), &places).unwrap();
        assert_eq!(ghost.mesh.mesh.triangles().len(), 24);
        let bounds = ghost.mesh.bounds();
        assert_eq!((bounds.min.x, bounds.max.x), (-1.0, 11.0));
    }

    #[test]
    fn a_part_in_another_unit_is_drawn_in_that_of_the_first() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("b.3mf");
        let mesh = cuboid(DVec3::splat(25.4)).mesh;
        let format = ravec::mesh_io::MeshFormat::ThreeMf;
        let mut target = ravec_jobs::mesh::MeshTarget::of(&path, format).unwrap();
        target.unit = Some(LengthUnit::Millimeter);
        ravec_jobs::mesh::write_mesh_file(&path, &mesh, &target, &Progress::none()).unwrap();
        let mut library = Library::default();
        let mut file = ravec_jobs::mesh::read_mesh_file(
            &path,
            &Context::default().mesh_limits(),
            &Progress::none(),
        )
        .unwrap();
        file.unit = Some(LengthUnit::Inch);
        let input = Content::Mesh(Arc::new(file));
        let scene = library
            .scene(&job(Some(path)), Some(&input), &Progress::none())
            .unwrap();
        let places = ["b:3,0,0".parse().unwrap()];
        let center = scene.parts[1].center(&places[0]).unwrap();
        assert!((center - DVec3::new(3.0, 0.0, 0.0)).length() < 1e-9);
        let box_edges = scene.parts[1].outline(&places[0]);
        let reach = box_edges.iter().flatten().map(|at| at.x);
        assert!((reach.fold(f64::MIN, f64::max) - 3.5).abs() < 1e-9);
    }

    #[test]
    fn the_longest_creases_are_lines() {
        assert_eq!(lines(&cuboid(DVec3::ONE).mesh).len(), 12);
        let ball = ravec_scenes::solids::icosphere(1.0, 4).mesh;
        assert!(lines(&ball).is_empty());
    }
}
