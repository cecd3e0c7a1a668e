//! From events to pictures: which frame is the first that shows what an event has caused.
//!
//! An event causes the requests that the window makes in its frame (or in the next one, if the edits have changed). A result, a quick
//! result or a frame of a clip that answers one of them, or a later one of the same kind, is its picture; an answer such as the region
//! of a dab is so only where none of these is asked for. The event is shown at the end of the frame that draws the picture: with all
//! tiles that are seen, or the picture of the mesh.

use crate::shown::TileIndex;
use crate::studio::{Counts, Source};
use crate::view::canvas::SeenTile;

/// Outcome of an event.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Fate {
    /// It was shown in the frame that has just ended.
    Shown,
    /// It has changed nothing.
    WithoutEffect,
}

/// An event that is followed.
#[derive(Debug, Clone)]
struct Followed<E> {
    event: E,
    /// True if another picture in its frame is its own.
    chooses: bool,
    stage: Stage,
}

#[derive(Debug, Clone)]
enum Stage {
    /// Its frame has not ended.
    New,
    /// The edits have changed, and the request may come in the next frame.
    Changed,
    /// The requests that wait for an answer.
    Asked(Vec<(Source, u64)>),
    /// The answer has changed the edits: the next frame draws them.
    Answered,
    /// The pictures that are to be drawn.
    Drawing(Wanted),
}

/// Pictures that a frame is to draw.
#[derive(Debug, Clone)]
struct Wanted {
    tiles: Vec<SeenTile>,
    mesh: u64,
}

impl Wanted {
    fn of(counts: &Counts) -> Self {
        Self {
            tiles: fine(counts).copied().collect(),
            mesh: counts.of(Source::Meshes).asked,
        }
    }

    /// True if a frame shows this or something newer.
    fn is_drawn(&self, now: &Counts) -> bool {
        let is_current = |seen: &SeenTile| seen.drawn == Some(seen.wanted);
        let is_there = |wanted: &SeenTile| {
            let same = |seen: &&SeenTile| (seen.slot, seen.tile) == (wanted.slot, wanted.tile);
            match fine(now).find(same) {
                Some(seen) => is_current(seen) || seen.drawn >= Some(wanted.wanted),
                // no longer seen, or a picture of another size is in its place
                None => fine(now)
                    .filter(|seen| seen.slot == wanted.slot)
                    .all(is_current),
            }
        };
        now.of(Source::Meshes).done >= self.mesh && self.tiles.iter().all(is_there)
    }
}

/// Follows events from frame to frame. `E` is what the caller knows about an event.
#[derive(Debug)]
pub(super) struct Watch<E> {
    followed: Vec<Followed<E>>,
    /// The state after the last frame.
    last: Counts,
}

impl<E: Clone> Watch<E> {
    pub fn new() -> Self {
        Self {
            followed: Vec::new(),
            last: Counts::default(),
        }
    }

    /// Follows an event of the frame that begins. One that `chooses` among pictures which are there already, such as a key or a turn of
    /// the wheel, has caused another picture in its frame; a motion has not.
    pub fn follow(&mut self, event: E, chooses: bool) {
        self.followed.push(Followed {
            event,
            chooses,
            stage: Stage::New,
        });
    }

    /// True if the next frame says more about an event.
    pub fn wants_frame(&self) -> bool {
        let soon =
            |followed: &Followed<E>| matches!(followed.stage, Stage::Changed | Stage::Answered);
        self.followed.iter().any(soon)
    }

    /// Takes the end of a frame that began in the state `before`; the events that have met their fate in it.
    pub fn end_frame(&mut self, before: &Counts, after: Counts) -> Vec<(E, Fate)> {
        let changed = after.has_other_edits(&self.last);
        let moved = after.view != self.last.view;
        let chosen = !fine(&after).map(state).eq(fine(&self.last).map(state));
        let (meshes, asked): (Vec<_>, Vec<_>) = asked(&self.last, &after)
            .into_iter()
            .partition(|(source, _)| *source == Source::Meshes);
        let turned = !meshes.is_empty();
        let mut fates = Vec::new();
        self.followed.retain_mut(|followed| {
            loop {
                followed.stage = match &followed.stage {
                    Stage::New | Stage::Changed if !asked.is_empty() => {
                        Stage::Asked(pictures(&asked))
                    }
                    Stage::New if turned => Stage::Drawing(Wanted::of(&after)),
                    Stage::New if changed => {
                        followed.stage = Stage::Changed;
                        return true;
                    }
                    Stage::New if moved || (chosen && followed.chooses) => {
                        Stage::Drawing(Wanted::of(&after))
                    }
                    Stage::New => {
                        fates.push((followed.event.clone(), Fate::WithoutEffect));
                        return false;
                    }
                    // the change is drawn by the window itself
                    Stage::Changed | Stage::Answered => Stage::Drawing(Wanted::of(&after)),
                    Stage::Asked(tickets) => {
                        let done =
                            |&(source, number): &(Source, u64)| before.of(source).done >= number;
                        if !tickets.iter().any(done) {
                            return true;
                        }
                        if changed && tickets.iter().all(|(source, _)| is_answer(*source)) {
                            followed.stage = Stage::Answered;
                            return true;
                        }
                        Stage::Drawing(Wanted::of(&after))
                    }
                    Stage::Drawing(wanted) => {
                        if wanted.is_drawn(&after) {
                            fates.push((followed.event.clone(), Fate::Shown));
                            return false;
                        }
                        return true;
                    }
                };
            }
        });
        self.last = after;
        fates
    }

    /// The events that are not shown, when nothing is going on any more.
    pub fn forget(&mut self) -> Vec<E> {
        self.followed
            .drain(..)
            .map(|followed| followed.event)
            .collect()
    }
}

/// The tiles of the size that suits the zoom.
fn fine(counts: &Counts) -> impl Iterator<Item = &SeenTile> {
    counts.tiles.iter().filter(|seen| seen.is_fine)
}

/// The state of a tile that is to be shown.
fn state(seen: &SeenTile) -> (usize, TileIndex, u64) {
    (seen.slot, seen.tile, seen.wanted)
}

fn is_answer(source: Source) -> bool {
    matches!(source, Source::Answers(_))
}

/// The requests between two states.
fn asked(before: &Counts, after: &Counts) -> Vec<(Source, u64)> {
    let sources = after.sources.iter();
    let newer = sources.filter(|(source, count)| count.asked > before.of(**source).asked);
    newer
        .map(|(source, count)| (*source, count.asked))
        .collect()
}

/// Of some requests those whose answers are pictures of the result, or all if there is none.
fn pictures(asked: &[(Source, u64)]) -> Vec<(Source, u64)> {
    let result = |&&(source, _): &&(Source, u64)| {
        matches!(source, Source::Results | Source::Drafts | Source::Frames)
    };
    let of_result: Vec<_> = asked.iter().filter(result).copied().collect();
    if of_result.is_empty() {
        asked.to_vec()
    } else {
        of_result
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::document::Edit;
    use crate::studio::Count;
    use std::sync::Arc;

    const TILE: TileIndex = TileIndex {
        level: 0,
        col: 0,
        row: 0,
    };

    fn counts(sources: &[(Source, u64, u64)], tile: Option<(u64, Option<u64>)>) -> Counts {
        let tiles = tile.map(|(wanted, drawn)| SeenTile {
            slot: 0,
            tile: TILE,
            is_fine: true,
            wanted,
            drawn,
        });
        Counts {
            sources: sources
                .iter()
                .map(|&(source, asked, done)| (source, Count { asked, done }))
                .collect(),
            tiles: tiles.into_iter().collect(),
            ..Counts::default()
        }
    }

    #[test]
    fn an_event_is_shown_once_the_tiles_of_its_picture_are_drawn() {
        let mut watch = Watch::new();
        let idle = counts(&[(Source::Results, 1, 1)], Some((5, Some(5))));
        watch.end_frame(&idle, idle.clone());
        watch.follow("first", false);
        let asked = counts(&[(Source::Results, 2, 1)], Some((5, Some(5))));
        assert!(watch.end_frame(&idle, asked.clone()).is_empty());
        // a later request of the same kind takes its place
        watch.follow("second", false);
        let again = counts(&[(Source::Results, 3, 1)], Some((5, Some(5))));
        assert!(watch.end_frame(&asked, again).is_empty());
        // the answer is there, its tile is not
        let answered = counts(&[(Source::Results, 3, 3)], Some((9, Some(5))));
        assert!(watch.end_frame(&answered, answered.clone()).is_empty());
        // the tile of the answer is drawn, while a newer one is wanted already
        let drawn = counts(&[(Source::Results, 4, 3)], Some((12, Some(9))));
        let fates = watch.end_frame(&drawn, drawn.clone());
        assert_eq!(fates, [("first", Fate::Shown), ("second", Fate::Shown)]);
        assert_eq!(watch.forget(), [""; 0]);
    }

    #[test]
    fn an_answer_that_came_during_a_frame_is_drawn_by_the_next_one() {
        let mut watch = Watch::new();
        let idle = counts(&[(Source::Drafts, 1, 1)], None);
        watch.end_frame(&idle, idle.clone());
        watch.follow(1, false);
        let asked = counts(&[(Source::Drafts, 2, 1)], None);
        watch.end_frame(&idle, asked.clone());
        let done = counts(&[(Source::Drafts, 2, 2)], None);
        assert!(watch.end_frame(&asked, done.clone()).is_empty());
        assert_eq!(watch.end_frame(&done, done.clone()), [(1, Fate::Shown)]);
    }

    #[test]
    fn answers_count_only_where_no_result_is_asked_for() {
        let region = Source::Answers("region");
        let mut watch = Watch::new();
        watch.follow(1, false);
        let asked = counts(&[(region, 1, 0), (Source::Drafts, 1, 0)], None);
        watch.end_frame(&Counts::default(), asked);
        let region_done = counts(&[(region, 1, 1), (Source::Drafts, 1, 0)], None);
        assert!(
            watch
                .end_frame(&region_done, region_done.clone())
                .is_empty()
        );
        assert_eq!(watch.forget(), [1]);
    }

    #[test]
    fn an_event_without_effect_has_no_time() {
        let mut watch = Watch::new();
        let idle = counts(&[(Source::Results, 1, 1)], Some((5, Some(5))));
        watch.end_frame(&idle, idle.clone());
        watch.follow(1, false);
        let fates = watch.end_frame(&idle, idle.clone());
        assert_eq!(fates, [(1, Fate::WithoutEffect)]);
    }

    #[test]
    fn a_key_may_choose_another_picture_and_a_motion_may_not() {
        let idle = counts(&[], Some((5, Some(5))));
        let other = counts(&[], Some((6, Some(6))));
        for (chooses, fate) in [(true, Fate::Shown), (false, Fate::WithoutEffect)] {
            let mut watch = Watch::new();
            watch.end_frame(&idle, idle.clone());
            watch.follow(1, chooses);
            assert_eq!(watch.end_frame(&idle, other.clone()), [(1, fate)]);
        }
    }

    #[test]
    fn a_changed_edit_waits_for_the_request_of_the_next_frame() {
        let mut watch = Watch::new();
        let idle = counts(&[(Source::Results, 1, 1)], None);
        watch.end_frame(&idle, idle.clone());
        watch.follow(1, false);
        let edit = Edit {
            id: 1,
            operation: "brush".to_owned(),
            fields: serde_json::Map::new(),
            more_sizes: Vec::new(),
            enabled: true,
        };
        let mut changed = idle.clone();
        changed.edits = vec![Arc::new(edit)];
        assert!(watch.end_frame(&idle, changed.clone()).is_empty());
        assert!(watch.wants_frame());
        let mut asked = counts(&[(Source::Results, 2, 1)], None);
        asked.edits.clone_from(&changed.edits);
        assert!(watch.end_frame(&changed, asked.clone()).is_empty());
        asked
            .sources
            .insert(Source::Results, Count { asked: 2, done: 2 });
        assert_eq!(watch.end_frame(&asked, asked.clone()), [(1, Fate::Shown)]);
    }
}
