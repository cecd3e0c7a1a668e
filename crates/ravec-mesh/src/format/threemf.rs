//! 3MF: the 3D Manufacturing Format, XML in an archive.
//!
//! Read are the items that the model builds, with their components and transforms and from all parts of the archive (the
//! production extension); each use of an object makes new vertices, in the unit that the model names. Transforms that
//! mirror turn the triangles around, so that their outside stays outside. Materials, colors, slices and beam lattices are
//! left out.
//!
//! Cost: the archive is held in memory, its parts are unpacked as a stream; each object is held once beside the result.

mod package;
mod xml;

use glam::DAffine3;
use ravec_progress::Progress;
use rustc_hash::FxHashMap;

use self::package::Package;
use self::xml::{Model, Room, Use};
use super::MeshFormat;
use super::error::{Place, ReadMeshError};
use super::read::MeshFile;
use super::soup::Soup;
use super::source::Source;

/// How deep components may be nested. Real files have one to three levels; the way down is on the stack.
const DEEPEST: usize = 64;

pub(super) fn read(source: Source<'_>) -> Result<MeshFile, ReadMeshError> {
    let (progress, limits) = (source.progress, source.limits);
    let mut package = Package::open(source)?;
    let mut room = Room::new(&limits);
    let mut parts = Parts::default();
    let root = package.root()?;
    parts.add(&root);
    let mut next = 0;
    while next < parts.names.len() {
        let name = parts.names[next].clone();
        let model = read_model(&mut package, &name, &mut room, progress)?;
        let objects = model.objects.values();
        let uses = objects
            .flat_map(|object| &object.components)
            .chain(&model.items);
        for path in uses.filter_map(|object| object.path.as_deref()) {
            parts.add(path);
        }
        parts.models.push(model);
        next += 1;
    }

    let mut soup = Soup::new(MeshFormat::ThreeMf, &limits);
    let mut scene = Scene {
        parts: &parts,
        counts: FxHashMap::default(),
        progress,
    };
    let root = &parts.models[0];
    let mut total = 0_u64;
    for item in &root.items {
        total = total.saturating_add(scene.count(0, item, 0)?);
    }
    soup.check_room(total)?;
    for item in &root.items {
        scene.place(0, item, &DAffine3::IDENTITY, &mut soup)?;
    }
    for warning in parts.models.iter().flat_map(|model| &model.warnings) {
        soup.warn(warning.clone());
    }
    soup.finish(Some(root.unit), progress)
}

fn read_model(
    package: &mut Package,
    name: &str,
    room: &mut Room,
    progress: &Progress,
) -> Result<Model, ReadMeshError> {
    let Some(part) = package.part(name)? else {
        let name = super::number::shown(name.as_bytes());
        let what = format!("the part {name}, which is referred to, is not in the archive");
        return Err(ReadMeshError::syntax(
            MeshFormat::ThreeMf,
            Place::Byte(0),
            what,
        ));
    };
    match xml::read_part(part, name, room, progress) {
        Ok(model) => Ok(model),
        Err(Ok(error)) => Err(error),
        Err(Err(xml::TooLarge)) => Err(package.too_large()),
    }
}

/// All parts that are needed, the root first.
#[derive(Default)]
struct Parts {
    names: Vec<String>,
    models: Vec<Model>,
    numbers: FxHashMap<String, usize>,
}

impl Parts {
    fn add(&mut self, path: &str) {
        let key = path.trim_start_matches('/').to_ascii_lowercase();
        if !self.numbers.contains_key(&key) {
            self.numbers.insert(key, self.names.len());
            self.names.push(path.to_owned());
        }
    }

    /// The number of the part that `object`, used in `part`, is in.
    fn of(&self, part: usize, object: &Use) -> usize {
        let path = object.path.as_deref();
        let key = path.map(|path| path.trim_start_matches('/').to_ascii_lowercase());
        // All paths were added when their parts were read.
        key.and_then(|key| self.numbers.get(&key).copied())
            .unwrap_or(part)
    }
}

/// The tree of uses, while it is walked.
struct Scene<'a> {
    parts: &'a Parts,
    /// How many triangles an object has with its components; nothing while it is counted.
    counts: FxHashMap<(usize, u32), Option<u64>>,
    progress: &'a Progress,
}

impl Scene<'_> {
    fn fault(object: u32, what: &str) -> ReadMeshError {
        let place = Place::Item {
            of: "object",
            index: u64::from(object),
        };
        ReadMeshError::syntax(MeshFormat::ThreeMf, place, what)
    }

    /// How many triangles `used` brings. Each object is counted once, so that nothing is walked more often than it has
    /// something to give.
    fn count(&mut self, part: usize, used: &Use, depth: usize) -> Result<u64, ReadMeshError> {
        let part = self.parts.of(part, used);
        let key = (part, used.object);
        match self.counts.get(&key) {
            Some(Some(count)) => return Ok(*count),
            Some(None) => return Err(Self::fault(used.object, "it is a component of itself")),
            None => {}
        }
        let Some(object) = self.parts.models[part].objects.get(&used.object) else {
            return Err(Self::fault(
                used.object,
                "it is used, but there is no such object",
            ));
        };
        if depth > DEEPEST {
            return Err(Self::fault(
                used.object,
                &format!("components are nested more than {DEEPEST} deep"),
            ));
        }
        self.counts.insert(key, None);
        let mut count = object.triangles.len() as u64;
        for component in &object.components {
            count = count.saturating_add(self.count(part, component, depth + 1)?);
        }
        self.counts.insert(key, Some(count));
        Ok(count)
    }

    /// Adds the triangles that `used` brings.
    fn place(
        &self,
        part: usize,
        used: &Use,
        world_from_parent: &DAffine3,
        soup: &mut Soup,
    ) -> Result<(), ReadMeshError> {
        self.progress.check()?;
        let part = self.parts.of(part, used);
        let Some(object) = self.parts.models[part].objects.get(&used.object) else {
            return Ok(());
        };
        if self.counts.get(&(part, used.object)) == Some(&Some(0)) {
            return Ok(());
        }
        let place = Place::Item {
            of: "object",
            index: u64::from(used.object),
        };
        let world_from_object = *world_from_parent * used.parent_from_object;
        let moves = world_from_object != DAffine3::IDENTITY;
        let mirrors = world_from_object.matrix3.determinant() < 0.0;
        let begin = soup.vertices() as u32;
        if !object.triangles.is_empty() {
            for &at in &object.positions {
                let at = if moves {
                    world_from_object.transform_point3(at)
                } else {
                    at
                };
                soup.vertex(at, place)?;
            }
        }
        for &triangle in &object.triangles {
            let [a, b, c] = triangle.map(|corner| begin + corner);
            soup.face(&if mirrors { [a, c, b] } else { [a, b, c] })?;
        }
        for component in &object.components {
            self.place(part, component, &world_from_object, soup)?;
        }
        Ok(())
    }
}
