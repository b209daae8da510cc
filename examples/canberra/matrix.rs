//! The two matrices of the model as pictures.

#![expect(clippy::cast_possible_wrap, reason = "places are small numbers")]

use plotters::prelude::*;
use plotters::style::text_anchor::HPos;
use wayfix::{SparseTransition, TransitionEntries, canberra};

use crate::figures::{Area, Drawn, anchored, font};

/// Entries of a transition matrix: to, from, probability.
pub(crate) fn entries(transition: &SparseTransition) -> Vec<(usize, usize, f64)> {
    let columns = 0..canberra::PLACES;
    columns.flat_map(|j| transition.outgoing(&(), j).map(move |(i, p)| (i, j, p))).collect()
}

/// Draws a matrix as lightness: the lighter, the larger.
pub(crate) fn draw(
    area: &Area<'_>,
    title: &str,
    columns: &str,
    rows: &str,
    entries: &[(usize, usize, f64)],
) -> Drawn {
    const CELL: i32 = 7;
    let (left, top) = (80, 60);
    let side = CELL * canberra::PLACES as i32;
    // The scale ends at the largest entry, so that small matrices are as readable as large ones.
    let largest = entries.iter().map(|entry| entry.2).fold(0.0, f64::max);
    let colour = |p: f64| ViridisRGB.get_color(p / largest);
    area.draw(&Text::new(title.to_owned(), (left, 18), font(20)))?;
    area.draw(&Rectangle::new([(left, top), (left + side, top + side)], colour(0.0).filled()))?;
    // Smaller entries would be as dark as the ground, which is drawn once.
    for &(i, j, p) in entries.iter().filter(|entry| entry.2 > 1e-3) {
        let (x, y) = (left + CELL * j as i32, top + CELL * i as i32);
        area.draw(&Rectangle::new([(x, y), (x + CELL, y + CELL)], colour(p).filled()))?;
    }
    for place in [1, 15, 30, 45, 60, 75, 90, 105] {
        let at = CELL * place - CELL / 2;
        let label = Text::new(
            place.to_string(),
            (left + at, top + side + 14),
            anchored(&font(14), HPos::Center),
        );
        area.draw(&label)?;
        area.draw(&Text::new(
            place.to_string(),
            (left - 8, top + at),
            anchored(&font(14), HPos::Right),
        ))?;
    }
    let middle = side / 2;
    area.draw(&Text::new(
        columns.to_owned(),
        (left + middle, top + side + 38),
        anchored(&font(16), HPos::Center),
    ))?;
    let turned = font(16).transform(FontTransform::Rotate270);
    area.draw(&Text::new(
        rows.to_owned(),
        (left - 58, top + middle),
        anchored(&turned, HPos::Center),
    ))?;
    // Colour scale.
    let (x, height) = (left + side + 30, 400);
    for y in 0..height {
        let p = largest * f64::from(height - y) / f64::from(height);
        area.draw(&Rectangle::new([(x, top + y), (x + 24, top + y + 1)], colour(p).filled()))?;
    }
    for tenth in 0..=(largest * 10.0).floor() as i32 {
        let p = f64::from(tenth) / 10.0;
        let y = top + height - (f64::from(height) * p / largest).round() as i32;
        area.draw(&Text::new(format!("{p:.1}"), (x + 32, y), anchored(&font(14), HPos::Left)))?;
    }
    Ok(())
}
