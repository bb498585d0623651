//! Speed over time of one move.
//!
//! ```text
//!   speed
//!     │    ┌────────┐          short moves never reach the plateau: a triangle
//!     │   ╱│        │╲
//!     │  ╱ │        │ ╲
//!     └─┴──┴────────┴──┴── time
//! ```
//! A profile has distance and time only. Its owner decides on the unit of distance: steps, or millimetres along a path.

#[derive(Debug, Clone, Copy, PartialEq)]
struct Segment {
    seconds: f64,
    from: f64,
    speed: f64,
    acceleration: f64,
}

/// Distance travelled as a function of the time since the move began.
#[derive(Debug, Clone, PartialEq)]
pub struct MotionProfile {
    segments: Vec<Segment>,
    distance: f64,
}

impl MotionProfile {
    /// From rest to rest over `distance`, never faster than `speed`.
    pub fn trapezoid(distance: f64, speed: f64, acceleration: f64) -> Self {
        let peak = speed.min((distance * acceleration).sqrt());
        let ramp_s = peak / acceleration;
        let ramp = 0.5 * peak * ramp_s;
        let plateau = (distance - 2.0 * ramp).max(0.0);
        let segments = vec![
            Segment { seconds: ramp_s, from: 0.0, speed: 0.0, acceleration },
            Segment { seconds: if peak > 0.0 { plateau / peak } else { 0.0 }, from: ramp, speed: peak, acceleration: 0.0 },
            Segment { seconds: ramp_s, from: ramp + plateau, speed: peak, acceleration: -acceleration },
        ];
        Self { segments, distance }
    }

    /// Brakes from `speed` at the distance `from` to rest as fast as `acceleration` allows, but not beyond the distance `limit`.
    pub fn braking(from: f64, speed: f64, acceleration: f64, limit: f64) -> Self {
        let seconds = speed / acceleration;
        let distance = (from + 0.5 * speed * seconds).min(limit);
        Self { segments: vec![Segment { seconds, from, speed, acceleration: -acceleration }], distance }
    }

    /// Time of the whole move, s.
    pub fn duration_s(&self) -> f64 {
        self.segments.iter().map(|s| s.seconds).sum()
    }

    /// The distance at the end of the move.
    pub fn distance(&self) -> f64 {
        self.distance
    }

    /// The distance travelled `elapsed_s` after the start.
    pub fn travelled(&self, elapsed_s: f64) -> f64 {
        match self.find(elapsed_s) {
            Some((s, t)) => (s.from + s.speed * t + 0.5 * s.acceleration * t * t).clamp(0.0, self.distance),
            None => self.distance,
        }
    }

    /// The speed `elapsed_s` after the start, per second.
    pub fn speed(&self, elapsed_s: f64) -> f64 {
        self.find(elapsed_s).map_or(0.0, |(s, t)| (s.speed + s.acceleration * t).max(0.0))
    }

    /// The time from the start until `distance` has been travelled, s. It is the duration for any longer distance.
    pub fn time_at_s(&self, distance: f64) -> f64 {
        let (mut low, mut high) = (0.0, self.duration_s());
        // After 60 bisections the interval is smaller than the resolution of an f64, which has 53 bits.
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if self.travelled(middle) < distance { low = middle } else { high = middle }
        }
        high
    }

    fn find(&self, elapsed_s: f64) -> Option<(&Segment, f64)> {
        let mut t = elapsed_s.max(0.0);
        for segment in &self.segments {
            if t < segment.seconds {
                return Some((segment, t));
            }
            t -= segment.seconds;
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Distance is the integral of speed. The midpoint sum has an error below one slice at peak speed for each of the four kinks.
        #[test]
        fn distance_is_the_integral_of_speed(distance in 0.1f64..5000.0, speed in 1.0f64..2000.0, acceleration in 10.0f64..50_000.0) {
            let p = MotionProfile::trapezoid(distance, speed, acceleration);
            let n = 4000;
            let dt = p.duration_s() / f64::from(n);
            let sum: f64 = (0..n).map(|i| p.speed((f64::from(i) + 0.5) * dt) * dt).sum();
            prop_assert!((sum - distance).abs() <= 4.0 * speed * dt, "{sum} for {distance}");
            prop_assert!((p.travelled(p.duration_s()) - distance).abs() < 1e-9 * distance.max(1.0));
            let half = p.time_at_s(0.5 * distance);
            prop_assert!((half - 0.5 * p.duration_s()).abs() < 1e-6 * p.duration_s(), "a trapezoid is symmetric");
        }

        #[test]
        fn braking_continues_position_and_speed_and_ends_within_the_move(speed in 1.0f64..2000.0, part in 0.01f64..0.99) {
            let p = MotionProfile::trapezoid(800.0, speed, 4000.0);
            let t = part * p.duration_s();
            let b = MotionProfile::braking(p.travelled(t), p.speed(t), 4000.0, p.distance());
            prop_assert!((b.travelled(0.0) - p.travelled(t)).abs() < 1e-9);
            prop_assert!((b.speed(0.0) - p.speed(t)).abs() < 1e-9);
            prop_assert!(b.distance() <= 800.0 && b.speed(b.duration_s()) == 0.0);
        }
    }
}
