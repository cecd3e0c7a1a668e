//! Meshes that are drawn many times.

use super::*;

/// Many kinds of edges: of one, two and three triangles, flat ones, and a vertex that nobody uses.
fn odd() -> TriMesh {
    let fin = mesh(
        vec![
            DVec3::ZERO,
            DVec3::X,
            DVec3::new(0.5, -0.8, 1.4),
            DVec3::splat(9.0),
            DVec3::new(0.5, 0.0, 0.0),
        ],
        vec![[0, 1, 2], [0, 1, 4], [2, 2, 1]],
    );
    together(&[cube(), fin, sphere(2)])
}

#[test]
fn pictures_of_prepared_meshes_are_those_of_others() {
    let odd = odd();
    let prepared = PreparedMesh::new(std::sync::Arc::new(odd.clone()));
    let section = Some(Section {
        normal: DVec3::new(1.0, 0.2, 0.0),
        offset: 0.4,
        capped: true,
    });
    let wireframe = Some(LineStyle {
        color: RED,
        width_px: 1.0,
    });
    let mut params = vec![plain()];
    for view in [View::FRONT, View::ISO] {
        for angle in [10.0, 40.0] {
            params.push(RenderParams {
                camera: from(view),
                smooth_angle_deg: angle,
                features: Some(FeatureLines {
                    angle_deg: angle,
                    silhouettes: angle < 20.0,
                    ..FeatureLines::default()
                }),
                ..plain()
            });
        }
        params.push(RenderParams {
            camera: from(view),
            section,
            wireframe,
            smooth_angle_deg: 0.0,
            ..plain()
        });
    }
    // forth and back, so that what was kept for other parameters is there
    for params in params.iter().chain(params.iter().rev()) {
        let found = prepared.render(&Paint::Plain, params, &Progress::none());
        assert_eq!(found.unwrap().picture, shown(&odd, &Paint::Plain, params));
    }
    assert_eq!(prepared.mesh().triangles(), odd.triangles());
}

#[test]
fn a_cancelled_picture_leaves_nothing_half_done() {
    let odd = odd();
    let params = RenderParams {
        features: Some(FeatureLines::default()),
        ..plain()
    };
    let expected = shown(&odd, &Paint::Plain, &params);
    let prepared = PreparedMesh::new(std::sync::Arc::new(odd));
    for check in 1..40 {
        let cancelled = Progress::cancelled_at(check);
        match prepared.render(&Paint::Plain, &params, &cancelled) {
            Ok(rendering) => assert_eq!(rendering.picture, expected),
            Err(error) => assert_eq!(error, RenderError::Cancelled(Cancelled)),
        }
    }
    let found = prepared.render(&Paint::Plain, &params, &Progress::none());
    assert_eq!(found.unwrap().picture, expected);
}

#[test]
fn without_shading_all_of_the_front_has_its_color() {
    let params = RenderParams {
        shaded: false,
        front_color: GREEN,
        ..plain()
    };
    let picture = shown(&sphere(3), &Paint::Plain, &params);
    let green = count(&picture, |pixel| pixel == [0, 255, 0, 255]);
    let inside = count(&picture, |pixel| pixel[3] == 255);
    assert!(inside > 1000 && green == inside, "{green} of {inside}");
}
