use super::*;
use crate::forms::{GridRun, Kind};
use crate::grid::Grid;
use glam::{DVec2, dvec2};
use nalgebra::{DMatrix, DVector};
use ravec_raster::Size;

fn grid(adaptive: bool) -> Grid {
    Grid::new(Size::new(120, 90).unwrap(), [12, 9], |col, row| {
        if adaptive && col < 8 && row < 8 && !(4..8).contains(&row) {
            2
        } else {
            1
        }
    })
}

fn runs() -> Vec<GridRun> {
    vec![
        GridRun {
            strength: 1.0,
            ends: [dvec2(1.2, 0.7), dvec2(10.5, 7.9)],
        },
        GridRun {
            strength: 1.0,
            ends: [dvec2(0.0, 4.5), dvec2(12.0, 4.6)],
        },
        GridRun {
            strength: 1.0,
            ends: [dvec2(6.1, 0.0), dvec2(6.1, 8.5)],
        },
    ]
}

/// Weights without any pattern.
fn weights(grid: &Grid) -> Vec<f64> {
    (0..grid.cells.len())
        .map(|k| 0.02 + ((k * 37) % 50) as f64 / 51.0)
        .collect()
}

fn with_content<T>(adaptive: bool, borders: Borders, f: impl Fn(&Content<'_>) -> T) -> T {
    let grid = grid(adaptive);
    f(&Content {
        grid: &grid,
        weights: &weights(&grid),
        runs: &runs(),
        line_strength: 1.0,
        free_borders: borders == Borders::Free,
    })
}

/// The energy from its definition, over values of all nodes.
fn energy(forms: &Forms, nodes: &[f64], length: f64, scale: f64, only: Option<Kind>) -> f64 {
    forms
        .iter()
        .filter(|form| only.is_none_or(|kind| kind == form.kind))
        .map(|form| {
            let sum: f64 = form
                .terms
                .iter()
                .map(|&(node, c)| c * nodes[node as usize])
                .sum();
            form.weight * (sum - form.far * length - form.shift * scale).powi(2)
        })
        .sum()
}

#[test]
fn gradients_of_each_energy_agree_with_finite_differences() {
    with_content(true, Borders::Free, |content| {
        for axis in 0..2 {
            let forms = content.forms(axis);
            let nodes: Vec<f64> = (0..content.node_count())
                .map(|k| ((k * 53) % 97) as f64)
                .collect();
            let kinds = [
                Kind::Deformation,
                Kind::Line,
                Kind::Direction,
                Kind::Relaxation,
                Kind::Pull,
            ];
            for kind in kinds {
                let mut gradient = vec![0.0; nodes.len()];
                for form in forms.iter().filter(|form| form.kind == kind) {
                    let sum: f64 = form.terms.iter().map(|&(n, c)| c * nodes[n as usize]).sum();
                    let rest = sum - form.far * 80.0 - form.shift * 0.7;
                    for &(node, c) in form.terms {
                        gradient[node as usize] += 2.0 * form.weight * c * rest;
                    }
                }
                assert!(gradient.iter().any(|g| *g != 0.0), "{kind:?}");
                for k in (0..nodes.len()).step_by(7) {
                    let at = |by: f64| {
                        let mut moved = nodes.clone();
                        moved[k] += by;
                        energy(&forms, &moved, 80.0, 0.7, Some(kind))
                    };
                    // exact for a quadratic, up to the digits that the difference of two large numbers loses
                    let numeric = (at(1.0) - at(-1.0)) / 2.0;
                    let scale = at(0.0).abs() * 1e-12 + 1e-9;
                    assert!(
                        (gradient[k] - numeric).abs() < scale.max(1e-9 * numeric.abs()),
                        "{kind:?}"
                    );
                }
            }
        }
    });
}

#[test]
fn the_minimum_is_that_of_a_dense_solution_of_the_definition() {
    for (adaptive, borders) in [
        (false, Borders::Slide),
        (true, Borders::Slide),
        (false, Borders::Symmetric),
        (true, Borders::Free),
    ] {
        with_content(adaptive, borders, |content| {
            let axes = Axis::both(content, borders, false).unwrap();
            for (axis, system) in axes.iter().enumerate() {
                let (length, scale) = (71.0, 0.8);
                let z = system.unbounded(length, scale);
                let forms = content.forms(axis);
                // the dense system over the unknowns, from values of the definition alone
                let n = system.unknowns.count();
                let fixed = |k: usize| match system.unknowns.anchors[k] {
                    Anchor::Free => None,
                    Anchor::Near => Some(0.0),
                    Anchor::Far => Some(length),
                };
                let free: Vec<usize> = (0..n).filter(|&k| fixed(k).is_none()).collect();
                let rows: Vec<_> = forms.iter().collect();
                let mut matrix = DMatrix::zeros(rows.len(), free.len());
                let mut right = DVector::zeros(rows.len());
                for (r, form) in rows.iter().enumerate() {
                    let value = |z: &[f64]| -> f64 {
                        form.terms
                            .iter()
                            .map(|&(node, c)| c * system.unknowns.value(z, node))
                            .sum()
                    };
                    let base: Vec<f64> = (0..n).map(|k| fixed(k).unwrap_or(0.0)).collect();
                    let root = form.weight.sqrt();
                    right[r] = root * (form.far * length + form.shift * scale - value(&base));
                    for (c, &k) in free.iter().enumerate() {
                        let mut unit = vec![0.0; n];
                        unit[k] = 1.0;
                        matrix[(r, c)] = root * value(&unit);
                    }
                }
                let normal = matrix.transpose() * &matrix;
                let solved = normal
                    .cholesky()
                    .unwrap()
                    .solve(&(matrix.transpose() * right));
                for (c, &k) in free.iter().enumerate() {
                    // weights from 0.02 to 40 leave twelve of sixteen digits
                    assert!(
                        (z[k] - solved[c]).abs() < 1e-6,
                        "{borders:?} {} {}",
                        z[k],
                        solved[c]
                    );
                }
                let nodes: Vec<f64> = (0..content.node_count() as u32)
                    .map(|node| system.unknowns.value(&z, node))
                    .collect();
                let least = energy(&forms, &nodes, length, scale, None);
                assert!((system.min_energy(length, scale) - least).abs() < 1e-9 * (1.0 + least));
            }
        });
    }
}

#[test]
fn one_factor_for_both_sides_is_plain_scaling_with_energy_0() {
    for adaptive in [false, true] {
        for borders in [Borders::Slide, Borders::Symmetric, Borders::Free] {
            with_content(adaptive, borders, |content| {
                let axes = Axis::both(content, borders, false).unwrap();
                for (axis, length) in [(0, 120.0 * 0.6), (1, 90.0 * 0.6)] {
                    let z = axes[axis].unbounded(length, 0.6);
                    for vertex in 0..content.grid.vertices.len() as u32 {
                        let expected = 0.6 * content.grid.position_px(vertex)[axis];
                        assert!((axes[axis].unknowns.value(&z, vertex) - expected).abs() < 1e-6);
                    }
                    assert!(axes[axis].min_energy(length, 0.6) < 1e-12);
                }
            });
        }
    }
}

#[test]
fn an_adaptive_grid_moves_like_the_regular_one_where_weights_are_even() {
    let moved = |adaptive: bool| {
        let grid = grid(adaptive);
        // one heavy block that both grids resolve; the rest is even
        let weights: Vec<f64> = grid
            .cells
            .iter()
            .map(|cell| {
                if cell.first[0] >= 8 && (4..7).contains(&cell.first[1]) {
                    1.0
                } else {
                    0.05
                }
            })
            .collect();
        let content = Content {
            grid: &grid,
            weights: &weights,
            runs: &[],
            line_strength: 1.0,
            free_borders: false,
        };
        let axes = Axis::both(&content, Borders::Slide, false).unwrap();
        let z = [axes[0].unbounded(70.0, 1.0), axes[1].unbounded(90.0, 1.0)];
        let place = |at: DVec2| -> DVec2 {
            let parts = grid.weights_at(at);
            let value = |a: usize| {
                let sum = parts
                    .iter()
                    .map(|&(v, w)| w * axes[a].unknowns.value(&z[a], v));
                sum.sum::<f64>()
            };
            dvec2(value(0), value(1))
        };
        (0..40)
            .map(|k| place(dvec2(f64::from(k) * 0.3, f64::from(k % 9) + 0.4)))
            .collect::<Vec<_>>()
    };
    for (a, b) in moved(false).into_iter().zip(moved(true)) {
        // of units of 10 pixels that change by up to 6; where cells are twice as large, curvature is lost
        assert!(a.distance(b) < 0.5, "{a} {b}");
    }
}

#[test]
fn following_the_edges_leads_to_the_minimum_with_them() {
    for (adaptive, borders) in [(false, Borders::Slide), (true, Borders::Free)] {
        with_content(adaptive, borders, |content| {
            for (axis, system) in Axis::both(content, borders, false).unwrap().iter().enumerate() {
                let (length, scale) = (71.0, 0.8);
                let forms = content.forms(axis);
                let total = |z: &[f64], target: &[f64]| {
                    let nodes: Vec<f64> = (0..content.node_count() as u32)
                        .map(|node| system.unknowns.value(z, node))
                        .collect();
                    let mut edges = vec![0.0; system.edges.len()];
                    system.edges.apply(z, length, &mut edges);
                    let away = edges.iter().zip(target).map(|(a, b)| (a - b).powi(2));
                    energy(&forms, &nodes, length, scale, None)
                        + system.stiffness * away.sum::<f64>()
                };
                let mut z = system.unbounded(length, scale);
                let mut target = vec![0.0; system.edges.len()];
                system.edges.apply(&z, length, &mut target);
                // twice, as steps follow each other
                let slope = |z: &[f64], target: &[f64]| {
                    let free = (0..z.len()).filter(|&k| system.unknowns.anchors[k] == Anchor::Free);
                    free.map(|k| {
                        let at = |by: f64| {
                            let mut moved = z.to_vec();
                            moved[k] += by;
                            total(&moved, target)
                        };
                        0.5 * (at(1.0) - at(-1.0)).abs()
                    })
                    .fold(0.0, f64::max)
                };
                for turn in 1..3 {
                    let change: Vec<f64> = (0..target.len())
                        .map(|k| ((k * 29 * turn) % 13) as f64 / 4.0 - 1.5)
                        .collect();
                    for (target, change) in target.iter_mut().zip(&change) {
                        *target += change;
                    }
                    let before = slope(&z, &target);
                    system.follow_edges(&change, &mut z);
                    // seven digits, less some for the condition
                    let after = slope(&z, &target);
                    assert!(after < 1e-4 * before, "{borders:?}: {after} of {before}");
                }
            }
        });
    }
}
