//! Expressions over meshes.
//!
//! An expression says of each place whether it is inside the result, given inside which meshes it is. [`Expr::known`] asks the
//! same where that is known of some of the meshes only, which settles whole regions at once; [`Expr::pruned`] leaves out
//! what cannot matter because boxes do not meet.
//!
//! Guarantees: [`Expr::flattened`] has the value of the expression everywhere, [`Expr::pruned`] wherever each mesh stays
//! within its box. Cost: linear in the number of terms; recursion as deep as the expression, which [`Expr::parse`] bounds.

mod parse;

use ravec_mesh::Aabb;
use rustc_hash::FxHashSet;

pub use parse::ParseExprError;

/// An expression over meshes, which are known by their index.
///
/// A union, a difference and a symmetric difference of no terms are nothing, an intersection of none is everything.
///
/// ```
/// use ravec_boolean::Expr;
///
/// let (expr, names) = Expr::parse("(plate | rib) - hole & zone")?;
/// assert_eq!(names, ["plate", "rib", "hole", "zone"]);
/// // inside the plate and the hole, outside of the rib and the zone: `&` binds more tightly than `-`
/// assert!(expr.eval(&|mesh| [true, false, true, false][mesh]));
/// # Ok::<(), ravec_boolean::ParseExprError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub enum Expr {
    /// A mesh.
    Mesh(usize),
    /// Union.
    Union(Vec<Expr>),
    /// Intersection.
    Intersection(Vec<Expr>),
    /// Difference: the first without the others.
    Difference(Vec<Expr>),
    /// Symmetric difference: the points inside an odd number of them.
    SymmetricDifference(Vec<Expr>),
}

/// Knowledge about a region, or about a mesh there.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Known {
    /// All of it is inside.
    In,
    /// All of it is outside.
    Out,
    /// It is not known, or some is inside and some is not.
    Unknown,
}

impl Expr {
    /// Returns `true` if a place is inside, given in which meshes it is.
    pub fn eval(&self, inside: &impl Fn(usize) -> bool) -> bool {
        match self {
            Self::Mesh(mesh) => inside(*mesh),
            Self::Union(terms) => terms.iter().any(|t| t.eval(inside)),
            Self::Intersection(terms) => terms.iter().all(|t| t.eval(inside)),
            Self::Difference(terms) => terms.split_first().is_some_and(|(first, rest)| {
                first.eval(inside) && !rest.iter().any(|t| t.eval(inside))
            }),
            Self::SymmetricDifference(terms) => {
                terms.iter().filter(|t| t.eval(inside)).count() % 2 == 1
            }
        }
    }

    /// Evaluates a region from the knowledge about the meshes there.
    ///
    /// Where it is [`Known::In`] or [`Known::Out`], that holds whatever the unknown meshes are. The reverse is not promised:
    /// terms are taken for independent, so that `a - a` is unknown where `a` is ([`Self::flattened`] makes nothing of it).
    pub fn known(&self, of: &impl Fn(usize) -> Known) -> Known {
        match self {
            Self::Mesh(mesh) => of(*mesh),
            Self::Union(terms) => any(terms, of),
            Self::Intersection(terms) => {
                let mut sum = Known::In;
                for term in terms {
                    match term.known(of) {
                        Known::Out => return Known::Out,
                        Known::Unknown => sum = Known::Unknown,
                        Known::In => {}
                    }
                }
                sum
            }
            Self::Difference(terms) => {
                let Some((first, rest)) = terms.split_first() else {
                    return Known::Out;
                };
                match (first.known(of), any(rest, of)) {
                    (Known::Out, _) | (_, Known::In) => Known::Out,
                    (Known::In, Known::Out) => Known::In,
                    _ => Known::Unknown,
                }
            }
            Self::SymmetricDifference(terms) => {
                let mut odd = false;
                for term in terms {
                    match term.known(of) {
                        Known::In => odd = !odd,
                        Known::Out => {}
                        Known::Unknown => return Known::Unknown,
                    }
                }
                if odd { Known::In } else { Known::Out }
            }
        }
    }

    /// The meshes that it speaks of, ascending, each once.
    pub fn meshes(&self) -> Vec<usize> {
        let mut meshes = Vec::new();
        self.gather(&mut meshes);
        meshes.sort_unstable();
        meshes.dedup();
        meshes
    }

    fn gather(&self, meshes: &mut Vec<usize>) {
        match self {
            Self::Mesh(mesh) => meshes.push(*mesh),
            Self::Union(terms)
            | Self::Intersection(terms)
            | Self::Difference(terms)
            | Self::SymmetricDifference(terms) => {
                for term in terms {
                    term.gather(meshes);
                }
            }
        }
    }

    /// Returns `true` if it is nothing: a union of no terms.
    pub fn is_nothing(&self) -> bool {
        matches!(self, Self::Union(terms) if terms.is_empty())
    }

    /// Nothing.
    fn nothing() -> Self {
        Self::Union(Vec::new())
    }

    /// The same with as few levels as can be: a union in a union becomes part of it, operators of one term go, terms that
    /// are there twice are there once or cancel.
    ///
    /// An empty expression becomes a union of no terms, and is left out of others.
    #[must_use]
    pub fn flattened(self) -> Self {
        match self {
            Self::Mesh(_) => self,
            Self::Union(terms) => {
                let mut flat = Vec::with_capacity(terms.len());
                for term in terms {
                    match term.flattened() {
                        Self::Union(inner) => flat.extend(inner),
                        term => flat.push(term),
                    }
                }
                Self::some(distinct(flat), Self::Union)
            }
            Self::Intersection(terms) => {
                let mut flat = Vec::with_capacity(terms.len());
                for term in terms {
                    match term.flattened() {
                        Self::Intersection(inner) => flat.extend(inner),
                        term if term.is_nothing() => return term,
                        term => flat.push(term),
                    }
                }
                Self::some(distinct(flat), Self::Intersection)
            }
            Self::Difference(terms) => {
                let mut terms = terms.into_iter().map(Self::flattened);
                let mut flat = match terms.next() {
                    None => return Self::nothing(),
                    Some(Self::Difference(inner)) => inner,
                    Some(first) => vec![first],
                };
                for term in terms {
                    match term {
                        Self::Union(inner) => flat.extend(inner),
                        term => flat.push(term),
                    }
                }
                let first = flat.swap_remove(0);
                let rest = distinct(flat);
                if first.is_nothing() || rest.contains(&first) {
                    return Self::nothing();
                }
                let mut terms = vec![first];
                terms.extend(rest);
                Self::some(terms, Self::Difference)
            }
            Self::SymmetricDifference(terms) => {
                let mut flat = Vec::with_capacity(terms.len());
                for term in terms {
                    match term.flattened() {
                        Self::SymmetricDifference(inner) => flat.extend(inner),
                        term if term.is_nothing() => {}
                        term => flat.push(term),
                    }
                }
                Self::some(odd(flat), Self::SymmetricDifference)
            }
        }
    }

    /// `operator` of `terms`; one term is itself. Of no terms all but an intersection are nothing.
    fn some(mut terms: Vec<Self>, operator: impl FnOnce(Vec<Self>) -> Self) -> Self {
        if terms.len() == 1 {
            return terms.remove(0);
        }
        match operator(terms) {
            Self::SymmetricDifference(terms) | Self::Difference(terms) if terms.is_empty() => {
                Self::nothing()
            }
            done => done,
        }
    }

    /// The same, flattened, without what cannot matter if each mesh is inside its box: `a - b` is `a` where the boxes do not
    /// meet, and `a & b` is nothing there.
    ///
    /// `bounds` has a box for each mesh, an empty one for a mesh that is nowhere; a mesh without an entry is taken to reach
    /// everywhere. Boxes that share a corner meet.
    #[must_use]
    pub fn pruned(&self, bounds: &[Aabb]) -> Self {
        let flat = self.clone().flattened();
        let (pruned, _) = flat.pruned_within(EVERYWHERE, bounds);
        pruned.flattened()
    }

    /// An expression with the same value as this one within `region`, and a box that holds all of it.
    ///
    /// Outside of `region` it may be too large, but never leaves the box that this would have had: so a value that is wrong
    /// there is never seen, since a term is pruned to a region only where the others are nothing outside of it.
    fn pruned_within(&self, region: Aabb, bounds: &[Aabb]) -> (Self, Aabb) {
        let none = || (Self::nothing(), Aabb::EMPTY);
        match self {
            Self::Mesh(mesh) => {
                let bounds = bounds.get(*mesh).copied().unwrap_or(EVERYWHERE);
                if bounds.is_empty() || !bounds.touches(&region) {
                    return none();
                }
                (self.clone(), bounds)
            }
            Self::Union(terms) => Self::gathered(terms, region, bounds, Self::Union),
            Self::SymmetricDifference(terms) => {
                Self::gathered(terms, region, bounds, Self::SymmetricDifference)
            }
            Self::Intersection(terms) => {
                let within = terms.iter().map(|term| term.bounds(bounds));
                let region = within.fold(region, common);
                if region.is_empty() {
                    return none();
                }
                let mut kept = Vec::with_capacity(terms.len());
                let mut around = EVERYWHERE;
                for term in terms {
                    let (term, bounds) = term.pruned_within(region, bounds);
                    if term.is_nothing() {
                        return none();
                    }
                    around = common(around, bounds);
                    kept.push(term);
                }
                (Self::Intersection(kept), around)
            }
            Self::Difference(terms) => {
                let Some((first, rest)) = terms.split_first() else {
                    return none();
                };
                let (first, around) = first.pruned_within(region, bounds);
                if first.is_nothing() {
                    return none();
                }
                let mut kept = vec![first];
                for term in rest {
                    let (term, _) = term.pruned_within(common(around, region), bounds);
                    if !term.is_nothing() {
                        kept.push(term);
                    }
                }
                (Self::Difference(kept), around)
            }
        }
    }

    /// Terms pruned within the same region, without those that are nothing.
    fn gathered(
        terms: &[Self],
        region: Aabb,
        bounds: &[Aabb],
        operator: impl FnOnce(Vec<Self>) -> Self,
    ) -> (Self, Aabb) {
        let mut kept = Vec::with_capacity(terms.len());
        let mut around = Aabb::EMPTY;
        for term in terms {
            let (term, bounds) = term.pruned_within(region, bounds);
            if !term.is_nothing() {
                around = around.union(bounds);
                kept.push(term);
            }
        }
        if kept.is_empty() {
            return (Self::nothing(), Aabb::EMPTY);
        }
        (operator(kept), around)
    }

    /// A box that holds all that is inside.
    fn bounds(&self, of: &[Aabb]) -> Aabb {
        match self {
            Self::Mesh(mesh) => of.get(*mesh).copied().unwrap_or(EVERYWHERE),
            Self::Union(terms) | Self::SymmetricDifference(terms) => {
                let boxes = terms.iter().map(|term| term.bounds(of));
                boxes.fold(Aabb::EMPTY, Aabb::union)
            }
            Self::Intersection(terms) => {
                let boxes = terms.iter().map(|term| term.bounds(of));
                boxes.fold(EVERYWHERE, common)
            }
            Self::Difference(terms) => terms.first().map_or(Aabb::EMPTY, |term| term.bounds(of)),
        }
    }
}

/// The box that holds all places.
const EVERYWHERE: Aabb = Aabb::new(glam::DVec3::NEG_INFINITY, glam::DVec3::INFINITY);

/// Intersection of two boxes.
fn common(a: Aabb, b: Aabb) -> Aabb {
    Aabb::new(a.min.max(b.min), a.max.min(b.max))
}

/// Evaluates a union.
fn any(terms: &[Expr], of: &impl Fn(usize) -> Known) -> Known {
    let mut sum = Known::Out;
    for term in terms {
        match term.known(of) {
            Known::In => return Known::In,
            Known::Unknown => sum = Known::Unknown,
            Known::Out => {}
        }
    }
    sum
}

/// Terms without repetitions.
fn distinct(mut terms: Vec<Expr>) -> Vec<Expr> {
    let mut seen = FxHashSet::default();
    terms.retain(|term| seen.insert(term.clone()));
    terms
}

/// The terms that are there an odd number of times, once.
fn odd(mut terms: Vec<Expr>) -> Vec<Expr> {
    let mut seen = FxHashSet::default();
    for term in &terms {
        if !seen.remove(term) {
            seen.insert(term.clone());
        }
    }
    // the first of each that is left; the others find it gone
    terms.retain(|term| seen.remove(term));
    terms
}

#[cfg(test)]
mod tests;
