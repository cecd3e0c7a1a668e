//! Fineness of the pictures of a mesh: drafts are as coarse as the last ones took time.

use ravec::mesh::TriMesh;
use std::sync::Arc;
use std::time::Duration;

/// Drafts that take longer become coarser, so that ten appear in a second.
const DRAFT_TIME: Duration = Duration::from_millis(80);

/// Fineness of a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Quality {
    pub samples: u32,
    /// Pixels of the screen for each pixel of the picture, along each side.
    pub divisor: u32,
    pub lines: bool,
}

pub(super) const FINE: Quality = Quality {
    samples: 2,
    divisor: 1,
    lines: true,
};

/// Drafts from the finest to the coarsest.
const DRAFTS: [Quality; 5] = [
    Quality {
        samples: 1,
        divisor: 1,
        lines: true,
    },
    Quality {
        samples: 1,
        divisor: 2,
        lines: true,
    },
    Quality {
        samples: 1,
        divisor: 2,
        lines: false,
    },
    Quality {
        samples: 1,
        divisor: 3,
        lines: false,
    },
    Quality {
        samples: 1,
        divisor: 4,
        lines: false,
    },
];

/// Coarseness of the first draft of a mesh, which finds out what does not depend on the view.
const FIRST: usize = 1;

/// Coarseness of drafts, by the time that they took.
#[derive(Default)]
pub(super) struct Pace {
    level: usize,
    mesh: Option<Arc<TriMesh>>,
    /// The coarsest level that took too long since the hand last rested: drafts that change to and fro would flicker.
    slow: Option<usize>,
    /// `true` if the draft that is being made is the first of its mesh, which takes longer than others.
    first: bool,
}

impl Pace {
    pub fn quality(&mut self, mesh: &Arc<TriMesh>) -> Quality {
        let known = self.mesh.as_ref();
        self.first = !known.is_some_and(|known| Arc::ptr_eq(known, mesh));
        if self.first {
            self.level = FIRST;
            self.slow = None;
            self.mesh = Some(mesh.clone());
        }
        DRAFTS[self.level]
    }

    /// Takes note of the time of a draft.
    pub fn record(&mut self, time: Duration) {
        if self.first {
            return;
        }
        // all pixels of the screen are four times as many as the next level has
        let room = if self.level == 1 { 4 } else { 2 };
        if time > DRAFT_TIME {
            self.slow = self.slow.max(Some(self.level));
            self.level = (self.level + 1).min(DRAFTS.len() - 1);
        } else if time < DRAFT_TIME / room && self.level > self.slow.map_or(0, |slow| slow + 1) {
            self.level -= 1;
        }
    }

    /// Takes note that the hand rests.
    pub fn rest(&mut self) {
        self.slow = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pace() -> Pace {
        let mesh = TriMesh::new(Vec::new(), Vec::new());
        let mut pace = Pace::default();
        let mesh = Arc::new(mesh.unwrap());
        assert_eq!(pace.quality(&mesh), DRAFTS[FIRST]);
        // the first draft computes what is kept
        pace.record(10 * DRAFT_TIME);
        assert_eq!(pace.quality(&mesh), DRAFTS[FIRST]);
        pace.record(DRAFT_TIME / 9);
        assert_eq!(pace.quality(&mesh), DRAFTS[0]);
        pace
    }

    #[test]
    fn slow_drafts_become_coarse_and_fast_ones_fine() {
        let mut pace = pace();
        for _ in 0..9 {
            pace.record(2 * DRAFT_TIME);
        }
        assert_eq!(pace.level, DRAFTS.len() - 1);
        pace.rest();
        for _ in 0..9 {
            pace.record(DRAFT_TIME / 9);
        }
        assert_eq!(pace.level, 0);
    }

    #[test]
    fn drafts_do_not_change_to_and_fro_while_the_hand_moves() {
        let mut pace = pace();
        let mut levels = Vec::new();
        for _ in 0..20 {
            pace.record(if pace.level < 2 {
                2 * DRAFT_TIME
            } else {
                DRAFT_TIME / 9
            });
            levels.push(pace.level);
        }
        assert!(levels[1..].iter().all(|&level| level == 2), "{levels:?}");
    }
}
