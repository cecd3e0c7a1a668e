//! A shot edited like one picture: background plates, removal, replacement, enhancement, paste.
