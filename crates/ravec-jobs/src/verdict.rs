//! The verdict on what a run has written, in one vocabulary for all operations.

use serde::Serialize;

/// Facts about the file that was written, and what became of the data beyond what was asked for.
///
/// A fact that an operation does not look for is absent. `solid` and `closed` are what `mesh check` says about the written file,
/// in its precision.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Verdict {
    /// The surface of a solid: closed, manifold, consistently oriented, facing out, and free of self-intersections. Not of an
    /// empty mesh.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub solid: Option<bool>,
    /// Every edge has as many triangles in one direction as in the other.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub closed: Option<bool>,
    /// The promised error bound is proved for all of the result.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub proved: Option<bool>,
    /// Changes of the data that were not asked for, as sentences.
    pub changed: Vec<String>,
    /// Content of the inputs that the output lacks, as sentences.
    pub dropped: Vec<String>,
    /// Assumptions about the inputs, as sentences.
    pub assumed: Vec<String>,
}

impl Verdict {
    /// The facts by name, in the order of their weight.
    pub fn facts(&self) -> impl Iterator<Item = (&'static str, bool)> + use<> {
        [
            ("solid", self.solid),
            ("closed", self.closed),
            ("proved", self.proved),
        ]
        .into_iter()
        .filter_map(|(name, fact)| Some((name, fact?)))
    }

    /// Numbers of sentences by name, zeros omitted.
    pub fn counts(&self) -> impl Iterator<Item = (&'static str, usize)> + use<> {
        [
            ("changed", self.changed.len()),
            ("dropped", self.dropped.len()),
            ("assumed", self.assumed.len()),
        ]
        .into_iter()
        .filter(|&(_, count)| count > 0)
    }

    /// One line, as in `passed: solid, closed; 2 assumed`; `None` if there is nothing to say. `passed` is that of the report.
    pub fn line(&self, passed: Option<bool>) -> Option<String> {
        let facts = self
            .facts()
            .map(|(name, fact)| format!("{}{name}", if fact { "" } else { "not " }));
        let facts: Vec<_> = facts.collect();
        let counts: Vec<_> = self
            .counts()
            .map(|(name, count)| format!("{count} {name}"))
            .collect();
        let parts = [facts.join(", "), counts.join(", ")];
        let parts: Vec<_> = parts.into_iter().filter(|part| !part.is_empty()).collect();
        let details = parts.join("; ");
        let word = match passed {
            Some(true) => "passed",
            Some(false) => "not passed",
            None if details.is_empty() => return None,
            None => return Some(details),
        };
        Some(if details.is_empty() {
            word.to_owned()
        } else {
            format!("{word}: {details}")
        })
    }

    /// Takes over the verdict of a later step: its facts, and its sentences behind those of earlier ones.
    pub(crate) fn absorb(&mut self, later: Self) {
        self.solid = later.solid;
        self.closed = later.closed;
        self.proved = later.proved;
        self.changed.extend(later.changed);
        self.dropped.extend(later.dropped);
        self.assumed.extend(later.assumed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_has_the_facts_and_the_numbers_of_sentences() {
        let mut verdict = Verdict::default();
        assert_eq!(verdict.line(None), None);
        assert_eq!(verdict.line(Some(true)).unwrap(), "passed");
        verdict.closed = Some(true);
        assert_eq!(verdict.line(None).unwrap(), "closed");
        verdict.solid = Some(false);
        verdict.assumed = vec!["a".to_owned(), "b".to_owned()];
        verdict.changed = vec!["c".to_owned()];
        let line = verdict.line(Some(false)).unwrap();
        assert_eq!(line, "not passed: not solid, closed; 1 changed, 2 assumed");
    }
}
