//! Messages of the system as people read them.

/// The message of an error without the number that the system has for it, such as `(os error 2)`.
pub fn message_without_code(cause: &impl std::fmt::Display) -> String {
    let text = cause.to_string();
    match text.rfind(" (os error ") {
        Some(at) if text.ends_with(')') => text[..at].to_owned(),
        _ => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_number_goes_and_the_sentence_stays() {
        let error = std::fs::File::open("/no such folder/a").unwrap_err();
        assert!(error.to_string().contains("os error"));
        let sentence = message_without_code(&error);
        assert!(
            !sentence.contains("os error") && !sentence.ends_with(' '),
            "{sentence}"
        );
        assert_eq!(
            message_without_code(&"(os error 2) was before"),
            "(os error 2) was before"
        );
    }
}
