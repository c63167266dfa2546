//! Kernels with opacities, as training makes them: in slabs each is spread along the ray as the others are.

use super::scenes::{looking_from, plane, tilted};
use super::*;

/// Kernels of all shapes in a ball; their opacities are from 0.1 to 0.95. Colours go by the place, or each has its own.
fn scene(is_motley: bool) -> Cloud {
    let indices = 0..2000;
    let color = |i: usize| if is_motley { any_color(i) } else { shades(in_ball(i) * 3.0) };
    splats(
        indices.clone().map(in_ball).collect(),
        indices.clone().map(any_shape).collect(),
        Strength::Opacity {
            peaks: indices.clone().map(|i| 0.1 + 0.85 * spread(i, 0.414_214)).collect(),
            filter: OpacityFilter::Compensated,
        },
        indices.map(color).collect(),
    )
}

#[test]
fn slabs_of_trained_kernels_are_ahead_of_sorted_centers() {
    let camera = looking_from(DVec3::new(2.5, 2.0, -4.5), 32);
    // Where slabs are asked for and there is no extinction, R1 spreads opacities along the ray.
    for (name, is_motley, least) in [("neighbours alike", false, 10.0), ("motley", true, 6.0)] {
        let cloud = scene(is_motley);
        let r1 = truth(std::slice::from_ref(&cloud), &camera, &nothing_but(SLABS));
        let error = |order| apart(&draw(vec![cloud.clone()], &camera, &nothing_but(order)), &r1).mean_error;
        let thicknesses = [2.45, 2.0, 1.0];
        let [whole, tent, thin] = thicknesses.map(|thickness| error(Order::Slabs { thickness }));
        let centers = error(Order::Centers);
        println!("{name}: centers {centers:.2e}, slabs of {thicknesses:?} {whole:.2e} {tent:.2e} {thin:.2e}");
        assert!(tent <= centers / least, "{name}: {centers} is not {least} times {tent}");
        assert!(thin <= centers / 100.0, "{name}: {centers} is not a hundred times {thin}");
    }
}

/// What else is in a scene shows trained kernels as these are without it.
#[test]
fn trained_kernels_look_beside_others_as_they_do_alone() {
    let camera = looking_from(DVec3::new(2.5, 2.0, -4.5), 48);
    let cloud = scene(true);
    let aside = tilted(30.0, DVec3::new(0.9, -0.8, 0.4));
    let sheet = plane(24, 0.06, [0.2, 0.9, 0.3]).transformed(aside);
    let fog = haze(8, 0.19, 3.0).transformed(aside);
    // Of a volume slabs are the integral the more nearly the thinner they are.
    let cases = [
        (&sheet, Order::Auto, 2e-5),
        (&fog, Order::Slabs { thickness: 2.0 }, 2.0 * LEVEL),
        (&fog, Order::Slabs { thickness: 1.0 }, LEVEL / 3.0),
        (&fog, Order::Slabs { thickness: 0.5 }, LEVEL / 12.0),
    ];
    for (other, order, bound) in cases {
        let settings = nothing_but(order);
        let clouds = [cloud.clone(), other.clone()];
        let alone = draw(vec![cloud.clone()], &camera, &nothing_but(Order::Auto));
        let [by_itself, both] =
            [vec![other.clone()], clouds.to_vec()].map(|clouds| draw(clouds, &camera, &settings));
        let empty: Vec<usize> = (0..both.color.len()).filter(|i| by_itself.color[*i][3] == 0.0).collect();
        assert!((500..both.color.len() - 300).contains(&empty.len()), "{} pixels are beside it", empty.len());
        let moved = apart_at(&empty, &alone, &both).max_error;
        assert!(moved <= 1e-6, "pixels beside the other change by {moved}, {order:?}");
        let found = apart(&both, &truth(&clouds, &camera, &settings));
        println!("{order:?} beside R1: {:.2e} at most", found.max_error);
        assert!(found.max_error <= bound, "{order:?}: {found:?}");
        assert!(apart(&both, &alone).max_error > 0.1, "the other hides nothing");
    }
}
