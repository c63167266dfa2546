//! Point clouds through the binary.

use crate::place::{Workplace, levels};

/// A square of 21² points in z = 0, far from the origin as on a map, red where x is small and blue where it is large.
fn square(place: &Workplace) {
    let mut text = String::new();
    for (row, column) in (0..21).flat_map(|row| (0..21).map(move |column| (row, column))) {
        let color = if column < 10 { "200 0 0" } else { "0 0 200" };
        text += &format!(
            "{} {} 50 {color}\n",
            500_000.0 + f64::from(column) / 20.0,
            4_000_000.0 + f64::from(row) / 20.0
        );
    }
    place.write("a.xyz", text);
}

#[test]
fn points_are_a_surface_where_they_say() {
    let place = Workplace::new();
    square(&place);
    let view = ["--size", "41x41", "--eye", "500000.5,4000000.5,60", "--target", "500000.5,4000000.5,50"];
    let lens = ["--up", "0,1,0", "--orthographic", "1.1", "--shade", "off", "--background", "000000"];
    place.run(&[&["render", "a.xyz"], &view[..], &lens[..]].concat());
    let picture = levels(&place.path("oblate.png"));
    // The levels of the file, with no hole between the points: more than 3.5 σ of 1.5 pixels from where the colour changes.
    for (column, row) in (4..13).flat_map(|column| (4..37).map(move |row| (column, row))) {
        let [r, _, b, a] = picture.get_pixel(column, row).0;
        assert!(r.abs_diff(200) <= 1 && b == 0 && a == 255, "{column} {row}: {r} {b}");
        let [r, _, b, _] = picture.get_pixel(40 - column, row).0;
        assert!(b.abs_diff(200) <= 1 && r == 0, "{column} {row}: {r} {b}");
    }

    let [out, _] = place.run(&["info", "a.xyz"]);
    for line in
        ["points      441", "attributes  colours", "bounds      500000, 4000000, 50 to 500001, 4000001, 50"]
    {
        assert!(out.lines().any(|l| l == line), "{line} in {out}");
    }
}

#[test]
fn a_scene_file_colours_and_places_them() {
    let place = Workplace::new();
    square(&place);
    place.write(
        "scene.toml",
        "version = 1\n[camera]\neye = [0, 0, 50]\ntarget = [0, 0, 0]\nup = [0, 1, 0]\northographic = 10\n[[points]]\npath = 'a.xyz'\n\
         point-color = 'height'\nscale = 4\ntranslate = [-2000002, -16000002, -200]\n[render]\nsize = [41, 41]\nshade = false\n",
    );
    place.run(&["render", "scene.toml"]);
    let picture = levels(&place.path("oblate.png"));
    let [r, g, b, _] = picture.get_pixel(20, 20).0;
    // One height: neither red nor blue of the file, nor the background.
    assert!([r, g, b] != [32; 3] && g > 0, "{r} {g} {b}");
    assert_eq!(picture.get_pixel(2, 2).0, [32, 32, 32, 255]);
    place.write("wrong.toml", "version = 1\n[[mesh]]\npath = 'a.xyz'\n");
    let message = place.refusal(&["render", "wrong.toml", "--size", "8x8"]);
    assert!(message.contains("a.xyz: it holds points; list it under [[points]]"), "{message}");
    assert!(place.refusal(&["render", "a.xyz", "--surfels", "3"]).contains("is for meshes; none is given"));
    let message = place.refusal(&["render", "a.xyz", "--point-color", "intensity", "--size", "8x8"]);
    assert!(message.contains("intensities"), "{message}");
}

/// Points of a slope that rises by 1 for 1 along x, from `x` to `x` + 1.
fn slope(x: usize) -> String {
    let at = |i: usize| f64::from(i as u32) / 20.0;
    let point = |i: usize| {
        let x = x as f64 + at(i % 20);
        format!("{x} {} {x}\n", at(i / 20))
    };
    (0..400).map(point).collect()
}

#[test]
fn tiles_share_their_colours() {
    let place = Workplace::new();
    place.write("a.xyz", slope(0));
    place.write("b.xyz", slope(1));
    place.write("both.xyz", slope(0) + &slope(1));
    let view = ["--size", "40x20", "--eye", "1,0.5,10", "--target", "1,0.5,0", "--orthographic", "1"];
    let options = ["--point-color", "height", "--shade", "off"];
    let picture = |files: &[&str]| {
        place.run(&[&["render"], files, &view, &options].concat());
        levels(&place.path("oblate.png"))
    };
    let (whole, tiles) = (picture(&["both.xyz"]), picture(&["a.xyz", "b.xyz"]));
    for (column, row) in (2..18).chain(22..38).flat_map(|column| (3..17).map(move |row| (column, row))) {
        let [whole, tiles] = [&whole, &tiles].map(|picture| picture.get_pixel(column, row).0);
        // Tiles' borders are blurred a little differently.
        assert!(
            whole.iter().zip(tiles).all(|(a, b)| a.abs_diff(b) <= 6),
            "{column} {row}: {whole:?} {tiles:?}"
        );
    }
}

#[test]
fn heights_are_along_what_is_up_in_the_world() {
    let place = Workplace::new();
    place.write("a.xyz", slope(0));
    let view = "version = 1\n[camera]\neye = [-10, 0.5, 0.5]\ntarget = [0.5, 0.5, 0.5]\northographic = 1\n\
                [render]\nsize = [20, 20]\nshade = false\nbackground = '000000'\n\
                [[points]]\npath = 'a.xyz'\npoint-color = 'height'\n";
    // The slope rises along x, its own z; turned about y it rises to the other side, upside down it falls.
    let colors = |place_of_it: &str, options: &[&str]| {
        place.write("scene.toml", format!("{view}{place_of_it}"));
        place.run(&[&["render", "scene.toml"], options].concat());
        let picture = levels(&place.path("oblate.png"));
        let green = |row: u32| {
            (0..20).map(move |column| (column, row)).map(|(c, r)| picture.get_pixel(c, r).0[1]).max()
        };
        [green(3), green(16)]
    };
    // Viridis grows greener.
    let [top, bottom] = colors("", &[]);
    assert!(top > bottom, "{top:?} {bottom:?}");
    // Half a turn about y through the middle: what is its own top is the bottom, and world heights count.
    let [top, bottom] = colors("rotate = [0, 180, 0]\ntranslate = [1, 0, 1]\n", &[]);
    assert!(top > bottom, "{top:?} {bottom:?}");
    let [top, bottom] = colors("", &["--up", "0,0,-1"]);
    assert!(top > bottom, "{top:?} {bottom:?}");
}
