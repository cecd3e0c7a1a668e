use super::*;
use glam::DVec3;
use proptest::prelude::*;

fn parsed(text: &str) -> Expr {
    Expr::parse_with(text, &["a", "b", "c", "d"]).unwrap()
}

/// All ways to be inside of four meshes.
fn cases() -> impl Iterator<Item = [bool; 4]> {
    (0..16_u32).map(|bits| std::array::from_fn(|mesh| bits >> mesh & 1 == 1))
}

fn same(a: &Expr, b: &Expr) -> bool {
    cases().all(|inside| a.eval(&|m| inside[m]) == b.eval(&|m| inside[m]))
}

/// Any expression of some levels over four meshes.
fn exprs() -> impl Strategy<Value = Expr> {
    let mesh = (0..4_usize).prop_map(Expr::Mesh);
    mesh.prop_recursive(4, 40, 4, |inner| {
        (0..4, prop::collection::vec(inner, 0..4)).prop_map(|(operator, terms)| match operator {
            0 => Expr::Union(terms),
            1 => Expr::Intersection(terms),
            2 => Expr::Difference(terms),
            _ => Expr::SymmetricDifference(terms),
        })
    })
}

/// An expression as text, with a parenthesis around each operator.
fn written(expr: &Expr) -> String {
    let join = |terms: &[Expr], operator: &str| {
        let terms: Vec<_> = terms.iter().map(written).collect();
        format!("({})", terms.join(operator))
    };
    match expr {
        Expr::Mesh(mesh) => ["a", "b", "c", "d"][*mesh].to_owned(),
        Expr::Union(terms) => join(terms, "|"),
        Expr::Intersection(terms) => join(terms, "&"),
        Expr::Difference(terms) => join(terms, " - "),
        Expr::SymmetricDifference(terms) => join(terms, " ^\n"),
    }
}

#[test]
fn intersections_bind_most_tightly_and_the_rest_goes_from_left_to_right() {
    for (text, meant) in [
        ("(a | b) - c & d", "(a | b) - (c & d)"),
        ("a | b - c & d", "(a | b) - (c & d)"),
        ("a - b | c", "(a - b) | c"),
        ("a ^ b - c", "(a ^ b) - c"),
        ("a & b | c & d", "(a & b) | (c & d)"),
        ("a - b - c", "(a - b) - c"),
        ("a-(b-c)", "a - (b - c)"),
    ] {
        assert!(same(&parsed(text), &parsed(meant)), "{text}");
    }
    assert!(!same(&parsed("a - (b - c)"), &parsed("a - b - c")));
}

#[test]
fn chains_of_an_operator_are_one_node() {
    let [a, b, c, d] = [0, 1, 2, 3].map(Expr::Mesh);
    assert_eq!(
        parsed("a - b & c & d"),
        Expr::Difference(vec![
            a.clone(),
            Expr::Intersection(vec![b.clone(), c.clone(), d.clone()])
        ])
    );
    assert_eq!(
        parsed("a ^ b ^ c ^ d"),
        Expr::SymmetricDifference(vec![a, b, c, d])
    );
}

#[test]
fn names_are_numbered_in_the_order_of_their_first_appearance() {
    let (expr, names) = Expr::parse("größe_2 & 7 | größe_2 ^ x").unwrap();
    assert_eq!(names, ["größe_2", "7", "x"]);
    assert_eq!(expr.meshes(), [0, 1, 2]);
}

#[test]
fn errors_say_where_and_what() {
    for (text, at, words) in [
        ("", 0, "but the expression ends"),
        ("  ", 2, "but the expression ends"),
        ("a |", 3, "after `|`, but the expression ends"),
        ("a | - b", 4, "after `|`, found `-`"),
        ("& a", 0, "found `&`"),
        ("a bc", 2, "operators | & - ^ before `bc`"),
        ("a (b)", 2, "before `(`"),
        ("(a | b", 0, "not closed"),
        ("(a b)", 3, "before `b`"),
        ("a)", 1, "has no opening one"),
        ("()", 1, "after `(`, found `)`"),
        ("a + b", 2, "unexpected `+`"),
        ("a | 'x", 4, "unexpected `'`"),
        ("a | foo", 4, "no mesh named `foo` (there are a, b)"),
    ] {
        let error = Expr::parse_with(
            text,
            &["a", "b", "bc"][..if text.contains("bc") { 3 } else { 2 }],
        );
        let error = error.unwrap_err();
        assert_eq!(error.at(), at, "{text}: {error}");
        assert!(error.to_string().contains(words), "{text}: {error}");
    }
}

#[test]
fn the_caret_counts_characters_and_not_bytes() {
    let error = Expr::parse("ä\t| +").unwrap_err();
    assert_eq!(error.caret("ä\t| +"), "ä | +\n    ^");
}

#[test]
fn deep_texts_are_refused_and_long_ones_are_not() {
    let deep = "(".repeat(100_000) + "a";
    assert!(matches!(
        Expr::parse(&deep),
        Err(ParseExprError::TooDeep { at: 200 })
    ));
    let alternating = "a-b|".repeat(100_000) + "a";
    assert!(matches!(
        Expr::parse(&alternating),
        Err(ParseExprError::TooDeep { .. })
    ));
    let long = "a|".repeat(100_000) + "a";
    assert_eq!(Expr::parse(&long).unwrap().0.flattened(), Expr::Mesh(0));
}

#[test]
fn terms_that_are_there_twice_count_once_or_cancel() {
    for (text, flat) in [
        ("a | (b | a)", "a | b"),
        ("a & (b & a)", "a & b"),
        ("(a - b) - (c | b)", "a - b - c"),
        ("a ^ (b ^ a)", "b"),
        ("a ^ b ^ a ^ c ^ a", "b ^ c ^ a"),
        ("(((a)))", "a"),
    ] {
        let (got, flat) = (parsed(text).flattened(), parsed(flat));
        assert!(same(&got, &flat), "{text}: {got:?}");
        assert_eq!(got.meshes(), flat.meshes(), "{text}");
    }
    assert!(parsed("(a | b) - a - (b | a)").flattened().meshes() == [0, 1]);
    assert!(parsed("a - a").flattened().is_nothing());
    assert!(parsed("b & (a ^ a)").flattened().is_nothing());
}

fn cube(low: f64, high: f64) -> Aabb {
    Aabb::new(DVec3::splat(low), DVec3::splat(high))
}

#[test]
fn what_boxes_keep_apart_is_left_out() {
    // b is apart from all others, c touches a, d is nowhere
    let bounds = [cube(0.0, 1.0), cube(5.0, 6.0), cube(1.0, 2.0), Aabb::EMPTY];
    for (text, pruned) in [
        ("a - b", "a"),
        ("a | b | d", "a | b"),
        ("a - c - b", "a - c"),
        ("(a | b) & c", "a & c"),
        ("(a ^ b) - (b & c)", "a ^ b"),
        ("a - (b | c - d)", "a - c"),
        ("(a | b - c) & b", "b & b"),
    ] {
        assert_eq!(
            parsed(text).pruned(&bounds),
            parsed(pruned).flattened(),
            "{text}"
        );
    }
    assert!(parsed("a & b").pruned(&bounds).is_nothing());
    assert!(parsed("d - a").pruned(&bounds).is_nothing());
    assert!(!parsed("a & c").pruned(&bounds).is_nothing());
}

proptest! {
    #[test]
    fn a_written_expression_is_read_as_it_was(expr in exprs()) {
        // operators of no term have no spelling
        let expr = expr.flattened();
        if !written(&expr).contains("()") {
            let read = parsed(&written(&expr));
            prop_assert!(same(&read, &expr), "{}", written(&expr));
        }
    }

    #[test]
    fn flattening_changes_no_value(expr in exprs()) {
        prop_assert!(same(&expr, &expr.clone().flattened()));
    }

    #[test]
    fn what_is_known_holds_whatever_the_unknown_is(expr in exprs(), unknown in 0..16_u32) {
        for inside in cases() {
            let of = |mesh: usize| match (unknown >> mesh & 1, inside[mesh]) {
                (1, _) => Known::Unknown,
                (_, true) => Known::In,
                (_, false) => Known::Out,
            };
            let value = expr.eval(&|mesh| inside[mesh]);
            match expr.known(&of) {
                Known::In => prop_assert!(value),
                Known::Out => prop_assert!(!value),
                Known::Unknown => prop_assert!(unknown != 0),
            }
        }
    }

    /// The meshes are the boxes themselves, on a line of whole places.
    #[test]
    fn pruning_changes_no_value_anywhere(
        expr in exprs(),
        ranges in prop::collection::vec((0..8_i32, 0..4_i32), 4),
    ) {
        let bounds: Vec<_> = ranges
            .iter()
            .map(|&(low, size)| cube(f64::from(low), f64::from(low + size)))
            .collect();
        let pruned = expr.pruned(&bounds);
        for place in -1..14 {
            let inside = |mesh: usize| bounds[mesh].contains(DVec3::splat(f64::from(place)));
            prop_assert_eq!(expr.eval(&inside), pruned.eval(&inside), "{} in {:?}", place, pruned);
        }
    }

    #[test]
    fn any_text_is_an_expression_or_an_error_with_its_place(text in "[a-c|&^() -]{0,30}|\\PC{0,20}") {
        if let Err(error) = Expr::parse(&text) {
            prop_assert!(error.at() <= text.len() && text.is_char_boundary(error.at()));
            prop_assert_eq!(error.caret(&text).lines().count(), 2);
        }
    }
}
