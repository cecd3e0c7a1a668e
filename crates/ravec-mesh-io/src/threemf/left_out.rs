//! Parts of a file that are not printed, gathered for one warning of each kind.

use crate::number::shown;
use crate::read::ReadWarning;

/// The most names that a warning shows.
const MAX_NAMES: usize = 5;

/// Things of one kind.
struct Group {
    what: &'static str,
    count: u64,
    names: Vec<String>,
}

impl Group {
    fn add(&mut self, name: &str) {
        self.count += 1;
        let name = shown(name.as_bytes());
        if !name.is_empty() && self.names.len() < MAX_NAMES && !self.names.contains(&name) {
            self.names.push(name);
        }
    }
}

/// All that is not in the mesh as a solid.
#[derive(Default)]
pub(super) struct LeftOut {
    groups: Vec<Group>,
    negative: Option<Group>,
}

impl LeftOut {
    /// Remembers one of the kind `what`, in the singular.
    pub(super) fn add(&mut self, what: &'static str, name: &str) {
        if let Some(group) = self.groups.iter_mut().find(|group| group.what == what) {
            return group.add(name);
        }
        let mut group = Group {
            what,
            count: 0,
            names: Vec::new(),
        };
        group.add(name);
        self.groups.push(group);
    }

    /// Remembers a negative volume.
    pub(super) fn add_negative(&mut self, name: &str) {
        let group = self.negative.get_or_insert(Group {
            what: "negative volume",
            count: 0,
            names: Vec::new(),
        });
        group.add(name);
    }

    /// A warning for each kind.
    pub(super) fn warnings(self) -> impl Iterator<Item = ReadWarning> {
        let negative = self.negative.map(|group| ReadWarning::NegativeVolumes {
            volumes: group.count,
            names: group.names,
        });
        let groups = self
            .groups
            .into_iter()
            .map(|group| ReadWarning::NotPrinted {
                what: group.what,
                count: group.count,
                names: group.names,
            });
        groups.chain(negative)
    }
}
