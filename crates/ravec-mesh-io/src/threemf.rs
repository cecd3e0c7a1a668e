//! 3MF: the 3D Manufacturing Format, XML in an archive.
//!
//! Read are the items that the model builds, with their components and transforms and from all parts of the archive (the
//! production extension); each use of an object makes new vertices, in the unit that the model names. Transforms that
//! mirror turn the triangles around, so that their outside stays outside. Materials, colors, slices and beam lattices are
//! left out, and so is what is not printed: objects of other types than `model`, items that are not printable, and the modifiers and
//! support volumes of slicers. Negative volumes are kept apart, for the solids to be subtracted.
//!
//! Cost: the archive is held in memory, its parts are unpacked as a stream; each object is held once beside the result.

mod left_out;
mod package;
mod parts;
mod settings;
mod xml;

use glam::DAffine3;
use ravec_memory::MemoryBudget;
use ravec_progress::Progress;

use self::left_out::LeftOut;
use self::package::Package;
use self::parts::Parts;
use self::settings::{Role, Settings};
use self::xml::{Kind, Model, Object, Room, Use};
use crate::MeshFormat;
use crate::error::{Place, ReadMeshError};
use crate::objects::MeshObject;
use crate::read::{MeshFile, ReadWarning};
use crate::soup::Soup;
use crate::source::Source;
use ravec_memory::ReservedVec;

/// Largest depth of nested components. Real files have one to three levels; the way down is on the stack.
const MAX_DEPTH: usize = 64;

/// Number of vertices and triangles that are placed between two checks for cancellation.
const AT_ONCE: usize = 1 << 16;

pub(super) fn read(source: Source<'_>) -> Result<MeshFile, ReadMeshError> {
    let (progress, limits) = (source.progress, source.limits.clone());
    let budget = &limits.memory;
    let mut package = Package::open(source)?;
    let mut room = Room::new(&limits);
    let mut parts = Parts::new(budget);
    let root = package.root(budget.reserve_nothing())?;
    parts.number(&root)?;
    let mut models: ReservedVec<Model> = ReservedVec::new(budget);
    while let Some(name) = parts.path(models.len()) {
        let Some(part) = package.part(name, budget.reserve_nothing())? else {
            let name = crate::number::shown(name.as_bytes());
            let what = format!("the part {name}, which is referred to, is not in the archive");
            let place = Place::Byte(0);
            return Err(ReadMeshError::syntax(MeshFormat::ThreeMf, place, what));
        };
        let model = xml::read_part(part, models.len(), &mut parts, &mut room)?;
        models.push(model)?;
    }
    let mut left_out = LeftOut::default();
    let mut soup = Soup::new(MeshFormat::ThreeMf, &limits);
    let mut settings = Settings::new(budget);
    for path in settings::PATHS {
        if let Some(part) = package.part(path, budget.reserve_nothing())?
            && !settings.read(part)?
        {
            soup.warn(ReadWarning::UnreadableSettings);
        }
    }
    drop(package);
    if let Some(root) = models.first_mut() {
        settings.apply(root, &mut left_out, budget, progress)?;
    }

    let mut scene = Scene::new(models, limits.memory.clone(), progress)?;
    scene.count_all(&mut left_out)?;
    scene.leave_out_what_is_empty(progress)?;
    let (items, unit) = (&scene.models[0].items, scene.models[0].unit);
    let total = items.iter().fold(Count::default(), |total, item| {
        total.plus(scene.known_count(item))
    });
    soup.check_room(total.triangles)?;
    soup.claim(total.vertices, total.triangles)?;
    let mut placed = Placed {
        soup,
        negative: Soup::new(MeshFormat::ThreeMf, &limits),
    };
    let mut objects: ReservedVec<MeshObject> = ReservedVec::new(budget);
    let mut names = budget.reserve_nothing();
    for item in items.iter() {
        let (triangles, negative) = placed.triangles();
        scene.place(item, &DAffine3::IDENTITY, false, &mut placed)?;
        let (end, negative_end) = placed.triangles();
        if end == triangles {
            continue;
        }
        let name = scene.object(item).map_or("", |(object, _)| &object.name);
        names.grow(name.len() as u64)?;
        objects.push(MeshObject {
            name: name.to_owned(),
            triangles: triangles..end,
            negative: negative..negative_end,
        })?;
    }
    let Placed { mut soup, negative } = placed;
    for warning in scene.models.iter().flat_map(|model| &model.warnings) {
        soup.warn(warning.clone());
    }
    for warning in left_out.warnings() {
        soup.warn(warning);
    }
    drop(scene);
    let negative = negative.finish(None, progress)?;
    let mut file = soup.finish(Some(unit), progress)?;
    let (objects, memory) = objects.into_parts();
    file.objects = objects;
    file.negative = negative.mesh;
    for memory in [memory, names] {
        file.memory.absorb(memory);
    }
    file.memory.absorb_all(negative.memory);
    Ok(file)
}

/// The triangles that were placed.
struct Placed {
    soup: Soup,
    /// Those of negative volumes.
    negative: Soup,
}

impl Placed {
    /// The numbers of triangles so far.
    fn triangles(&self) -> (usize, usize) {
        (self.soup.triangles(), self.negative.triangles())
    }
}

/// The vertices and triangles that an object brings with its components. Objects without triangles bring no vertices.
#[derive(Clone, Copy, Default)]
struct Count {
    vertices: u64,
    triangles: u64,
}

impl Count {
    fn plus(self, other: Self) -> Self {
        Self {
            vertices: self.vertices.saturating_add(other.vertices),
            triangles: self.triangles.saturating_add(other.triangles),
        }
    }
}

#[derive(Clone, Copy)]
enum Counted {
    NotYet,
    Started,
    Done(Count),
}

/// The tree of uses.
struct Scene<'a> {
    models: ReservedVec<Model>,
    /// Start of the objects of each part in `counts`.
    first: ReservedVec<usize>,
    counts: ReservedVec<Counted>,
    budget: MemoryBudget,
    progress: &'a Progress,
}

fn fault(object: u32, what: &str) -> ReadMeshError {
    let place = Place::Item {
        of: "object",
        index: u64::from(object),
    };
    ReadMeshError::syntax(MeshFormat::ThreeMf, place, what)
}

impl<'a> Scene<'a> {
    fn new(
        mut models: ReservedVec<Model>,
        budget: MemoryBudget,
        progress: &'a Progress,
    ) -> Result<Self, ReadMeshError> {
        let mut first = ReservedVec::new(&budget);
        let mut total = 0;
        for model in models.iter_mut() {
            progress.check()?;
            // to be found by their ids; the last one of an id counts, which is what `object` relies upon
            let _of_sorting =
                budget.reserve(ravec_memory::bytes_of::<Object>(model.objects.len()))?;
            model.objects.sort_by_key(|object| object.id);
            first.push(total)?;
            total += model.objects.len();
        }
        let mut counts = ReservedVec::new(&budget);
        counts.fill_up_to(total, Counted::NotYet)?;
        Ok(Self {
            models,
            first,
            counts,
            budget,
            progress,
        })
    }

    /// The object that is used, and its place in `counts`.
    fn object(&self, used: &Use) -> Option<(&Object, usize)> {
        let part = used.part as usize;
        let objects = &self.models[part].objects;
        let end = objects.partition_point(|object| object.id <= used.object);
        let object = objects[..end].last()?;
        (object.id == used.object).then_some((object, self.first[part] + end - 1))
    }

    fn count_all(&mut self, left_out: &mut LeftOut) -> Result<(), ReadMeshError> {
        for item in 0..self.models[0].items.len() {
            let Use { part, object, .. } = self.models[0].items[item];
            self.count(part, object, 0, left_out)?;
            self.remark(&self.models[0].items[item], left_out);
        }
        Ok(())
    }

    /// The kind of what a use would bring if it is not printed.
    fn auxiliary(&self, used: &Use) -> Option<&'static str> {
        match (used.role, self.object(used).map(|(object, _)| object.kind)) {
            (Some(Role::Auxiliary(what)), _) | (None, Some(Kind::Auxiliary(what))) => Some(what),
            _ => None,
        }
    }

    /// Remembers a use that is not printed.
    fn remark(&self, used: &Use, left_out: &mut LeftOut) {
        if let Some(what) = self.auxiliary(used) {
            let name = self.object(used).map_or("", |(object, _)| &object.name);
            left_out.add(what, name);
        }
    }

    /// Counts what an object brings. Each object is counted once, so that nothing is walked more often than it has something to
    /// give.
    fn count(
        &mut self,
        part: u32,
        id: u32,
        depth: usize,
        left_out: &mut LeftOut,
    ) -> Result<Count, ReadMeshError> {
        self.progress.check()?;
        let used = Use {
            part,
            object: id,
            parent_from_object: DAffine3::IDENTITY,
            role: None,
        };
        let Some((object, at)) = self.object(&used) else {
            return Err(fault(id, "it is used, but there is no such object"));
        };
        match self.counts[at] {
            Counted::Done(count) => return Ok(count),
            Counted::Started => return Err(fault(id, "it is a component of itself")),
            Counted::NotYet => {}
        }
        if depth > MAX_DEPTH {
            let what = format!("components are nested more than {MAX_DEPTH} deep");
            return Err(fault(id, &what));
        }
        let triangles = object.triangles.len() as u64;
        let vertices = object.positions.len() as u64;
        let mut count = Count {
            vertices: if triangles > 0 { vertices } else { 0 },
            triangles,
        };
        let components = object.components.len();
        self.counts[at] = Counted::Started;
        for component in 0..components {
            // found again, because counting changes the scene
            let Some((object, _)) = self.object(&used) else {
                break;
            };
            let used = &object.components[component];
            let (part, id, is_left_out) = (used.part, used.object, self.auxiliary(used).is_some());
            self.remark(used, left_out);
            let brought = self.count(part, id, depth + 1, left_out)?;
            if !is_left_out {
                count = count.plus(brought);
            }
        }
        self.counts[at] = Counted::Done(count);
        Ok(count)
    }

    /// The count of a use.
    fn known_count(&self, used: &Use) -> Count {
        if self.auxiliary(used).is_some() {
            return Count::default();
        }
        match self.object(used).map(|(_, at)| self.counts[at]) {
            Some(Counted::Done(count)) => count,
            _ => Count::default(),
        }
    }

    /// Removes the components that bring nothing: an object that has millions of them may be used a million times.
    fn leave_out_what_is_empty(&mut self, progress: &Progress) -> Result<(), ReadMeshError> {
        for part in 0..self.models.len() {
            for object in 0..self.models[part].objects.len() {
                progress.check()?;
                let objects = &mut self.models[part].objects;
                let empty = ReservedVec::new(&self.budget);
                let mut components = std::mem::replace(&mut objects[object].components, empty);
                components.retain(|used| self.known_count(used).triangles > 0);
                self.models[part].objects[object].components = components;
            }
        }
        Ok(())
    }

    /// Adds the triangles that `used` brings, which is a part of a negative volume if `negative`.
    fn place(
        &self,
        used: &Use,
        world_from_parent: &DAffine3,
        negative: bool,
        placed: &mut Placed,
    ) -> Result<(), ReadMeshError> {
        self.progress.check()?;
        if self.auxiliary(used).is_some() {
            return Ok(());
        }
        let negative = negative || used.role == Some(Role::Negative);
        let soup = if negative {
            &mut placed.negative
        } else {
            &mut placed.soup
        };
        let Some((object, _)) = self.object(used) else {
            return Ok(());
        };
        let place = Place::Item {
            of: "object",
            index: u64::from(used.object),
        };
        let world_from_object = *world_from_parent * used.parent_from_object;
        let moves = world_from_object != DAffine3::IDENTITY;
        let mirrors = world_from_object.matrix3.determinant() < 0.0;
        let begin = soup.vertices() as u32;
        if !object.triangles.is_empty() {
            for positions in object.positions.chunks(AT_ONCE) {
                self.progress.check()?;
                for &at in positions {
                    let at = if moves {
                        world_from_object.transform_point3(at)
                    } else {
                        at
                    };
                    soup.vertex(at, place)?;
                }
            }
        }
        for triangles in object.triangles.chunks(AT_ONCE) {
            self.progress.check()?;
            for &triangle in triangles {
                let [a, b, c] = triangle.map(|corner| begin + corner);
                soup.face(&if mirrors { [a, c, b] } else { [a, b, c] })?;
            }
        }
        for component in object.components.iter() {
            self.place(component, &world_from_object, negative, placed)?;
        }
        Ok(())
    }
}
