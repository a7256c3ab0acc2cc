//! Heat maps: the cost of camera rays per pixel, as in the paper's Figures 4 and 5.
//!
//! Every pixel shows a mean over its camera rays. Pictures that are to be compared share one scale, stated in the
//! legend; it ends at the 99.5th percentile of all of them, and larger values are clamped to it.

use crate::film::Picture;
use crate::font;
use crate::options::Heat;
use crate::render::Job;
use crate::stage::Stage;
use crate::world::World;
use mbkd::Counters;
use rayon::prelude::*;
use std::sync::atomic::{AtomicBool, Ordering};

/// Mean counts per pixel.
pub struct Counts {
    /// The title above the picture.
    pub title: String,
    values: Vec<f32>,
}

impl Heat {
    /// The counted events, in words.
    pub fn noun(self) -> &'static str {
        match self {
            Heat::Steps => "steps",
            Heat::Tests => "tests",
            Heat::TimeSkips => "time skips",
        }
    }

    fn of(self, counters: &Counters) -> u64 {
        match self {
            Heat::Steps => counters.steps(),
            Heat::Tests => counters.primitive_tests,
            Heat::TimeSkips => counters.time_skips,
        }
    }
}

/// Counts the cost of the camera rays of all pixels; `None` if interrupted.
pub fn count(world: &World, stage: &Stage, job: &Job, heat: Heat, title: String, stop: &AtomicBool) -> Option<Counts> {
    let pixel = |at: usize| {
        let mut counters = Counters::default();
        for sample in 0..job.samples {
            let (ray, _) = job.ray(stage, at % job.width, at / job.width, sample);
            world.closest(&ray, &mut counters);
        }
        heat.of(&counters) as f32 / job.samples as f32
    };
    let row = |y: usize| -> Vec<f32> {
        if stop.load(Ordering::Relaxed) { vec![] } else { (y * job.width..(y + 1) * job.width).map(pixel).collect() }
    };
    let values: Vec<f32> = (0..job.height).into_par_iter().flat_map_iter(row).collect();
    (values.len() == job.width * job.height).then_some(Counts { title, values })
}

impl Counts {
    /// The mean over the picture.
    pub fn mean(&self) -> f64 {
        self.values.iter().map(|&v| f64::from(v)).sum::<f64>() / self.values.len().max(1) as f64
    }

    /// The largest pixel.
    pub fn most(&self) -> f32 {
        self.values.iter().fold(0.0, |most, &v| v.max(most))
    }
}

const BAR: usize = 26;
const MARGIN: usize = 8;
const INK: [u8; 3] = [235, 235, 235];
const PAPER: [u8; 3] = [18, 18, 22];

/// The maps side by side, each under its title, over one legend.
pub fn draw(maps: &[Counts], job: &Job, heat: Heat) -> Picture {
    let top = scale_end(maps);
    let text = if job.width * maps.len() < 420 { 1 } else { 2 };
    let line = font::HEIGHT * text + 2 * MARGIN;
    let width = maps.len() * job.width + (maps.len() - 1) * MARGIN;
    let legend = BAR + 2 * line;
    let mut picture = Picture::filled(width, line + job.height + legend, PAPER);
    for (i, map) in maps.iter().enumerate() {
        let x = i * (job.width + MARGIN);
        let title = title(map, job.width.saturating_sub(MARGIN) / (font::ADVANCE * text));
        font::write(&mut picture, &title, x + MARGIN, MARGIN, text, INK);
        let pixels = map.values.iter().map(|v| mbkd_scenes::heat(v / top)).collect();
        picture.paste(&Picture { width: job.width, height: job.height, pixels }, x, line);
    }
    // The scale, from 0 to the top, with five marks.
    let below = line + job.height;
    font::write(&mut picture, &format!("{} per camera ray", heat.noun()), MARGIN, below + MARGIN, text, INK);
    let (from, length) = (MARGIN, width.saturating_sub(2 * MARGIN).max(1));
    let ramp: Vec<[u8; 3]> = (0..length).map(|x| mbkd_scenes::heat(x as f32 / length as f32)).collect();
    let pixels = (0..BAR).flat_map(|_| ramp.iter().copied()).collect();
    picture.paste(&Picture { width: length, height: BAR, pixels }, from, below + line);
    let mut free = 0;
    for &mark in marks(length, text, top) {
        let label = label(mark, top);
        let room = label.len() * font::ADVANCE * text;
        let x = (from + length * mark / 4).saturating_sub(room * mark / 4).max(free);
        font::write(&mut picture, &label, x, below + line + BAR + MARGIN, text, INK);
        free = x + room + font::ADVANCE * text;
    }
    picture
}

/// As much of a map's title as has room for so many characters.
fn title(map: &Counts, room: usize) -> String {
    let mean = format!("{}: mean {:.1}", map.title, map.mean());
    let full = format!("{mean}, most {:.0}", map.most());
    let fits = |title: &String| title.chars().count() <= room;
    [full, mean].into_iter().find(fits).unwrap_or_else(|| map.title.chars().take(room).collect())
}

/// The label below a quarter of the scale.
fn label(mark: usize, top: f32) -> String {
    format!("{}{}", if mark == 4 { ">=" } else { "" }, top * mark as f32 / 4.0)
}

/// The quarters whose labels fit below a scale of `length` pixels: all, the ends and the middle, or the ends.
fn marks(length: usize, text: usize, top: f32) -> &'static [usize] {
    let choices: [&[usize]; 3] = [&[0, 1, 2, 3, 4], &[0, 2, 4], &[0, 4]];
    let fits = |marks: &&[usize]| {
        // Each label is as wide as the widest, and a character apart.
        let widest = marks.iter().map(|&mark| label(mark, top).len() + 1).max().unwrap_or(0);
        marks.len() * widest * font::ADVANCE * text <= length
    };
    choices.into_iter().find(fits).unwrap_or(&[4])
}

/// A round number near the 99.5th percentile of all pixels.
fn scale_end(maps: &[Counts]) -> f32 {
    let mut all: Vec<f32> = maps.iter().flat_map(|map| map.values.iter().copied()).collect();
    if all.is_empty() {
        return 4.0;
    }
    let at = (all.len() - 1) * 995 / 1000;
    let high = *all.select_nth_unstable_by(at, f32::total_cmp).1;
    // The next of 4, 8, 20, 40, 80, 200...: quarters of these are whole numbers.
    let mut decade = 1.0;
    loop {
        if let Some(end) = [4.0, 8.0, 20.0].into_iter().map(|x| x * decade).find(|end| *end >= high) {
            return end;
        }
        decade *= 10.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_that_do_not_fit_are_left_out() {
        assert_eq!(marks(1000, 1, 2000.0), [0, 1, 2, 3, 4]);
        assert_eq!(marks(18 * font::ADVANCE, 1, 20.0), [0, 2, 4]);
        assert_eq!(marks(10 * font::ADVANCE, 1, 20.0), [0, 4]);
        assert_eq!(marks(5, 1, 20.0), [4]);
    }

    #[test]
    fn titles_are_no_longer_than_their_maps() {
        let map = Counts { title: "paper-kd".into(), values: vec![1.0, 2.0] };
        assert_eq!(title(&map, 26), "paper-kd: mean 1.5, most 2");
        assert_eq!(title(&map, 25), "paper-kd: mean 1.5");
        assert_eq!(title(&map, 17), "paper-kd");
        assert_eq!(title(&map, 5), "paper");
    }

    #[test]
    fn the_scale_is_round_and_reaches_the_counts() {
        let map = |high: f32| Counts { title: String::new(), values: vec![0.0, high, high] };
        assert_eq!(scale_end(&[map(3.0), map(17.0)]), 20.0);
        assert_eq!(scale_end(&[map(0.0)]), 4.0);
        assert_eq!(scale_end(&[map(801.0)]), 2000.0);
    }
}
