//! Expressions.

/// An expression over meshes, which are known by their index.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Expr {
    /// A mesh.
    Mesh(usize),
    /// What is in any of them.
    Union(Vec<Expr>),
    /// What is in all of them.
    Intersection(Vec<Expr>),
    /// What is in the first and in none of the others.
    Difference(Vec<Expr>),
    /// What is in an odd number of them.
    SymmetricDifference(Vec<Expr>),
}

/// Why a text is no expression.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("not an expression")]
pub struct ParseExprError;

impl Expr {
    /// Whether a place is inside, given in which meshes it is.
    pub fn eval(&self, inside: &impl Fn(usize) -> bool) -> bool {
        match self {
            Self::Mesh(mesh) => inside(*mesh),
            Self::Union(terms) => terms.iter().any(|t| t.eval(inside)),
            Self::Intersection(terms) => terms.iter().all(|t| t.eval(inside)),
            Self::Difference(terms) => terms
                .split_first()
                .is_some_and(|(first, rest)| first.eval(inside) && !rest.iter().any(|t| t.eval(inside))),
            Self::SymmetricDifference(terms) => {
                terms.iter().filter(|t| t.eval(inside)).count() % 2 == 1
            }
        }
    }
}
