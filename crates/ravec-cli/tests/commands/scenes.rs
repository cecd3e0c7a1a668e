//! `ravec scenes`.

use crate::program::{code, files, ravec, stderr, stdout};

#[test]
fn scenes_come_with_their_truth_and_again_the_same() {
    let folder = tempfile::tempdir().unwrap();
    for out in ["one", "two"] {
        let arguments = [
            "scenes", "--out", out, "--width", "96", "--height", "64", "--seed", "5",
        ];
        let output = ravec(folder.path(), &arguments);
        assert_eq!(code(&output), 0, "{}", stderr(&output));
        assert!(stdout(&output).contains("seed 5"), "{}", stdout(&output));
    }
    let (one, two) = (
        files(&folder.path().join("one")),
        files(&folder.path().join("two")),
    );
    assert!(one.iter().any(|path| path.extension().unwrap() == "png"));
    assert!(one.iter().any(|path| path.extension().unwrap() == "json"));
    assert_eq!(one.len(), two.len());
    for (a, b) in one.iter().zip(&two) {
        assert_eq!(a.file_name(), b.file_name());
        assert_eq!(
            std::fs::read(a).unwrap(),
            std::fs::read(b).unwrap(),
            "{}",
            a.display()
        );
    }
}
