//! The colours of heat maps.

/// Black over violet and orange to pale yellow, with monotone brightness, for a value in [0, 1]. Others take the nearest end, NaN
/// that of 0.
///
/// ```
/// assert_eq!(mbkd_scenes::heat(f32::NAN), mbkd_scenes::heat(0.0));
/// assert_eq!(mbkd_scenes::heat(9.0), mbkd_scenes::heat(1.0));
/// ```
pub fn heat(value: f32) -> [u8; 3] {
    const STOPS: [[f32; 3]; 6] = [
        [4.0, 4.0, 12.0],
        [58.0, 14.0, 92.0],
        [140.0, 36.0, 104.0],
        [214.0, 72.0, 62.0],
        [250.0, 152.0, 38.0],
        [252.0, 248.0, 176.0],
    ];
    let at = if value.is_nan() { 0.0 } else { value.clamp(0.0, 1.0) } * (STOPS.len() - 1) as f32;
    let i = (at as usize).min(STOPS.len() - 2);
    let s = at - i as f32;
    std::array::from_fn(|k| (STOPS[i][k] + (STOPS[i + 1][k] - STOPS[i][k]) * s + 0.5) as u8)
}
