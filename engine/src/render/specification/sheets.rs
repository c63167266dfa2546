//! Two sheets of one layer.

use super::Sample;

/// How much of the colours of a layer's samples is shown, if it is two sheets, of which the near one hides the far one; `None` where rounding says which of
/// them a sample is of.
pub(super) fn shown(first: &Sample, taken: &[Sample]) -> Option<impl Fn(&Sample) -> f64 + use<>> {
    let sum = |of: &[Sample]| of.iter().map(|sample| sample.coverage).sum::<f64>();
    let mean = |some: &[Sample], of: fn(&Sample) -> f64| {
        some.iter().map(|sample| sample.coverage * of(sample)).sum::<f64>() / sum(some)
    };
    let (seen, gap) = (mean(taken, |s| s.z) - first.z, mean(taken, |s| s.plane));
    let (near, far): (Vec<Sample>, Vec<Sample>) = taken.iter().partition(|sample| sample.plane <= gap);
    let of_side = |is_back: bool| -> f64 {
        taken.iter().filter(|sample| sample.is_back == is_back).map(|sample| sample.coverage).sum()
    };
    let total = sum(taken);
    let own = if first.has_sides { of_side(false).max(of_side(true)) } else { total };
    let variance = taken.iter().map(|s| s.coverage * (s.plane - gap).powi(2)).sum::<f64>() / total;
    let apart = mean(&far, |s| s.plane) - mean(&near, |s| s.plane);
    let between = sum(&near) * sum(&far) / total.powi(2) * apart.powi(2);
    // Of no width it is a step, and there are no two sheets where one is empty.
    let from_to = |value: f64, [from, to]: [f64; 2]| {
        if value > from { ((value - from) / (to - from)).min(1.0) } else { 0.0 }
    };
    let least = first.tolerance / 16.0;
    let clearly = from_to(total * first.floor / own.min(1.0), [1.0, 2.0 - first.floor])
        * from_to(between, [0.75 * variance, 0.9 * variance])
        * from_to(apart, [least, 2.0 * least])
        * from_to(seen, [0.5 * least, least]);
    // They lie beside each other as long as there is room.
    let beside = sum(&far).min(1.0).min(1.0 - sum(&near).min(1.0)) / sum(&far).min(1.0);
    let hidden = if clearly > 0.0 { clearly * mean(&near, |s| s.opacity) * (1.0 - beside) } else { 0.0 };
    let at_gap = |s: &&Sample| (s.plane - gap).abs() <= 4e-6 * s.z.abs();
    if hidden * taken.iter().filter(at_gap).map(|s| s.coverage).sum::<f64>() > 1e-5 * total {
        return None;
    }
    Some(move |sample: &Sample| if sample.plane <= gap { 1.0 } else { 1.0 - hidden })
}
