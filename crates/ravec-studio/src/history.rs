//! Undo without end: the states of a document.

use crate::document::Document;

/// A document with its earlier and undone states.
#[derive(Debug, Clone)]
pub struct History {
    present: Document,
    past: Vec<Document>,
    future: Vec<Document>,
    /// Name of the gesture that made the present state, until it ends.
    gesture: Option<String>,
}

impl History {
    /// A history that begins with this state.
    pub fn new(document: Document) -> Self {
        Self {
            present: document,
            past: Vec::new(),
            future: Vec::new(),
            gesture: None,
        }
    }

    /// The document as it is.
    pub fn document(&self) -> &Document {
        &self.present
    }

    /// Takes a new state as a step that can be undone.
    pub fn commit(&mut self, document: Document) {
        self.gesture = None;
        self.push(document);
    }

    /// Takes a new state that belongs to a gesture, such as the drag of a slider: all states of one gesture are undone at once.
    pub fn change(&mut self, gesture: &str, document: Document) {
        if self.gesture.as_deref() == Some(gesture) {
            self.present = document;
            self.future.clear();
        } else {
            self.push(document);
            self.gesture = Some(gesture.to_owned());
        }
    }

    /// Ends the gesture, if one goes on.
    pub fn end_gesture(&mut self) {
        self.gesture = None;
    }

    /// True while a gesture goes on.
    pub fn in_gesture(&self) -> bool {
        self.gesture.is_some()
    }

    fn push(&mut self, document: Document) {
        if document != self.present {
            self.past
                .push(std::mem::replace(&mut self.present, document));
            self.future.clear();
        }
    }

    /// True if there is something to undo.
    pub fn can_undo(&self) -> bool {
        !self.past.is_empty()
    }

    /// True if there is something to redo.
    pub fn can_redo(&self) -> bool {
        !self.future.is_empty()
    }

    /// Goes back to the state before.
    pub fn undo(&mut self) {
        self.gesture = None;
        if let Some(document) = self.past.pop() {
            self.future
                .push(std::mem::replace(&mut self.present, document));
        }
    }

    /// Goes forward to the state that was undone last.
    pub fn redo(&mut self) {
        self.gesture = None;
        if let Some(document) = self.future.pop() {
            self.past
                .push(std::mem::replace(&mut self.present, document));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::Map;

    fn with(count: usize) -> Document {
        let mut document = Document::new("a.png");
        for _ in 0..count {
            document.push("twocolor", Map::new());
        }
        document
    }

    #[test]
    fn undo_and_redo_walk_through_the_states() {
        let mut history = History::new(with(0));
        history.commit(with(1));
        history.commit(with(2));
        history.undo();
        assert_eq!(history.document(), &with(1));
        history.undo();
        history.undo();
        assert_eq!(history.document(), &with(0));
        history.redo();
        assert_eq!(history.document(), &with(1));
        history.commit(with(3));
        assert!(!history.can_redo());
        history.undo();
        assert_eq!(history.document(), &with(1));
    }

    #[test]
    fn a_gesture_is_undone_at_once() {
        let mut history = History::new(with(0));
        for count in 1..5 {
            history.change("slider", with(count));
        }
        history.end_gesture();
        history.change("slider", with(6));
        history.undo();
        assert_eq!(history.document(), &with(4));
        history.undo();
        assert_eq!(history.document(), &with(0));
    }

    #[test]
    fn an_equal_state_is_no_step() {
        let mut history = History::new(with(1));
        history.commit(with(1));
        assert!(!history.can_undo());
    }
}
