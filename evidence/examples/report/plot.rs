//! A plot as SVG. The legend stands below the drawing, where it covers nothing.

use crate::page::{Axis, Plot, Series, Style};
use plotters::coord::Shift;
use plotters::coord::combinators::LogCoord;
use plotters::coord::ranged1d::{AsRangedCoord, Ranged, ValueFormatter};
use plotters::prelude::*;
use std::error::Error;

/// The palette of Okabe and Ito ("Color Universal Design", 2008), which colour-blind people can tell apart, without its
/// yellow, which is too pale for lines, and without black, the page's ink: that is ours.
const COLORS: [RGBColor; 6] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
];

const WIDTH: u32 = 760;
const DRAWING: u32 = 440;
/// Height of a row of the legend.
const ROW: u32 = 24;

/// Draws a plot.
pub fn svg(plot: &Plot) -> Result<String, Box<dyn Error>> {
    let mut text = String::new();
    let columns = if plot.series.iter().any(|s| s.label.len() > 34) { 1 } else { 2 };
    let rows = plot.series.len().div_ceil(columns) as u32;
    let size = (WIDTH, DRAWING + rows * ROW + 14);
    {
        let root = SVGBackend::with_string(&mut text, size).into_drawing_area();
        root.fill(&WHITE)?;
        let (drawing, legend) = root.split_vertically(DRAWING);
        let x = range(plot, &plot.x, |p| p.0);
        let y = range(plot, &plot.y, |p| p.1);
        let ((x0, x1), (y0, y1)) = (x, y);
        match (plot.x.log, plot.y.log) {
            (false, false) => draw(&drawing, plot, x0..x1, y0..y1)?,
            (true, false) => draw(&drawing, plot, powers(x0, x1), y0..y1)?,
            (false, true) => draw(&drawing, plot, x0..x1, powers(y0, y1))?,
            (true, true) => draw(&drawing, plot, powers(x0, x1), powers(y0, y1))?,
        }
        for (i, series) in plot.series.iter().enumerate() {
            let (column, row) = (i as u32 % columns as u32, i as u32 / columns as u32);
            let x = 70 + (column * (WIDTH - 70) / columns as u32) as i32;
            key(&legend, series, i, (x, (row * ROW + ROW / 2) as i32))?;
        }
        root.present()?;
    }
    Ok(text)
}

/// Whether a point can be drawn.
fn drawn(plot: &Plot, (x, y): (f64, f64)) -> bool {
    let fine = |v: f64, axis: &Axis| v.is_finite() && (!axis.log || v > 0.0);
    fine(x, &plot.x) && fine(y, &plot.y)
}

/// What an axis shows: all points, and a little more.
fn range(plot: &Plot, axis: &Axis, of: impl Fn((f64, f64)) -> f64) -> (f64, f64) {
    let points = plot.series.iter().flat_map(|s| &s.points).filter(|p| drawn(plot, **p));
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for value in points.map(|p| of(*p)) {
        (low, high) = (low.min(value), high.max(value));
    }
    if low > high {
        return (1.0, 10.0);
    }
    if axis.log {
        let more = (high / low).powf(0.05).max(1.15);
        return (low / more, high * more);
    }
    // Amounts begin at zero.
    if low >= 0.0 && low < 0.5 * high {
        low = 0.0;
    }
    let more = 0.05 * (high - low).max(1e-9 * high.abs()).max(1e-30);
    (if low == 0.0 { 0.0 } else { low - more }, high + more)
}

/// A logarithmic axis with labels at powers of ten; of two where there would be hardly any.
fn powers(low: f64, high: f64) -> LogCoord<f64> {
    (low..high).log_scale().base(if high / low < 100.0 { 2.0 } else { 10.0 }).into()
}

/// A number as short as it can be written.
fn short(value: f64) -> String {
    let size = value.abs();
    if size != 0.0 && !(1e-3..1e5).contains(&size) {
        return format!("{value:.1e}").replace(".0e", "e");
    }
    let digits = (2 - size.max(1e-9).log10().floor() as i32).clamp(0, 6) as usize;
    let text = format!("{value:.digits$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_string() } else { text }
}

type Area<'a, 'b> = DrawingArea<SVGBackend<'b>, Shift>;

fn draw<X, Y>(area: &Area<'_, '_>, plot: &Plot, x: X, y: Y) -> Result<(), Box<dyn Error>>
where
    X: AsRangedCoord<Value = f64>,
    Y: AsRangedCoord<Value = f64>,
    X::CoordDescType: Ranged<ValueType = f64> + ValueFormatter<f64>,
    Y::CoordDescType: Ranged<ValueType = f64> + ValueFormatter<f64>,
{
    let mut chart = ChartBuilder::on(area)
        .caption(&plot.title, ("sans-serif", 20))
        .margin(12)
        .margin_right(26)
        .x_label_area_size(50)
        .y_label_area_size(76)
        .build_cartesian_2d(x, y)?;
    chart
        .configure_mesh()
        .x_desc(&plot.x.label)
        .y_desc(&plot.y.label)
        .axis_desc_style(("sans-serif", 16))
        .label_style(("sans-serif", 14))
        .x_labels(8)
        .y_labels(8)
        .x_label_formatter(&|v| short(*v))
        .y_label_formatter(&|v| short(*v))
        .bold_line_style(RGBColor(128, 128, 128).mix(0.35))
        .light_line_style(RGBColor(128, 128, 128).mix(0.12))
        .draw()?;
    for (i, series) in plot.series.iter().enumerate() {
        let points: Vec<(f64, f64)> = series.points.iter().copied().filter(|p| drawn(plot, *p)).collect();
        let stroke = stroke(series, i);
        match series.style {
            Style::Points => {}
            Style::Dashed => _ = chart.draw_series(DashedLineSeries::new(points.iter().copied(), 7, 5, stroke))?,
            Style::Line | Style::LineAndPoints => {
                chart.draw_series(LineSeries::new(points.iter().copied(), stroke))?;
            }
        }
        if matches!(series.style, Style::Points | Style::LineAndPoints) {
            let plane = chart.plotting_area();
            for point in points {
                mark(area, plane.map_coordinate(&point), series, i)?;
            }
        }
    }
    Ok(())
}

fn stroke(series: &Series, i: usize) -> ShapeStyle {
    color(series, i).stroke_width(if series.ours { 4 } else { 2 })
}

/// Black for what is ours, else the color of a place in the list.
fn color(series: &Series, i: usize) -> RGBColor {
    if series.ours { BLACK } else { COLORS[i % COLORS.len()] }
}

/// A mark at a place of the whole picture. Shapes come round as colours do.
fn mark(area: &Area<'_, '_>, at: (i32, i32), series: &Series, i: usize) -> Result<(), Box<dyn Error>> {
    let base = area.get_base_pixel();
    let (x, y) = (at.0 - base.0, at.1 - base.1);
    let color = color(series, i);
    let r = if series.ours { 6 } else { 5 };
    let polygon = |corners: &[(i32, i32)]| Polygon::new(corners.to_vec(), color.filled());
    match i % 6 {
        0 => area.draw(&Circle::new((x, y), r, color.filled()))?,
        1 => area.draw(&polygon(&[(x - r, y - r), (x + r, y - r), (x + r, y + r), (x - r, y + r)]))?,
        2 => area.draw(&polygon(&[(x, y - r - 1), (x + r + 1, y + r), (x - r - 1, y + r)]))?,
        3 => area.draw(&polygon(&[(x, y - r - 2), (x + r + 2, y), (x, y + r + 2), (x - r - 2, y)]))?,
        4 => area.draw(&Cross::new((x, y), r, color.stroke_width(3)))?,
        _ => area.draw(&Circle::new((x, y), r, color.stroke_width(2)))?,
    }
    Ok(())
}

/// An entry of the legend.
fn key(area: &Area<'_, '_>, series: &Series, i: usize, (x, y): (i32, i32)) -> Result<(), Box<dyn Error>> {
    let base = area.get_base_pixel();
    let line = |from: i32, to: i32| PathElement::new(vec![(x + from, y), (x + to, y)], stroke(series, i));
    match series.style {
        Style::Points => {}
        Style::Dashed => {
            area.draw(&line(0, 7))?;
            area.draw(&line(12, 19))?;
            area.draw(&line(24, 31))?;
        }
        Style::Line | Style::LineAndPoints => area.draw(&line(0, 32))?,
    }
    if matches!(series.style, Style::Points | Style::LineAndPoints) {
        mark(area, (x + 16 + base.0, y + base.1), series, i)?;
    }
    area.draw(&Text::new(series.label.clone(), (x + 42, y - 8), ("sans-serif", 16)))?;
    Ok(())
}
