//! What the command line takes and refuses.

use crate::place::Workplace;

#[test]
fn help_lists_every_option_with_its_default() {
    let [help, _] = Workplace::new().run(&["render", "--help"]);
    for option in [
        "--size",
        "--fov",
        "--eye",
        "--target",
        "--up",
        "--iso",
        "--transfer",
        "--dims",
        "--type",
        "--endian",
        "--spacing",
        "--surfels",
        "--surfel-spacing",
        "--point-color",
        "--level",
        "--max-memory",
        "--shade",
        "--background",
        "--footprint",
        "--low-pass",
        "--blend",
        "--order",
        "--slab-thickness",
        "--show",
        "--tolerance",
        "--budget",
        "--level-of-detail",
        "--occlusion",
        "--interpolation",
        "--reference",
        "--samples",
        "--threads",
        "--repeat",
        "--stats",
        "--quiet",
        "--output",
    ] {
        assert!(help.contains(option), "{option} is missing");
    }
    let flat = help.split_whitespace().collect::<Vec<_>>().join(" ");
    for default in [
        "[default: 1024x1024]",
        "[default: 30]",
        "[default: oblate.png]",
        "[default: 202020]",
        "[default: auto]",
        "[default: 0.3]",
        "[default: 2]",
        "[default: linear; display where only trained splats are drawn]",
        "[default: on]",
        "[default: off]",
        "[default: 1/255]",
        "[default: scene]",
        "[default: as many as the tolerance asks for]",
        "[default: all cores]",
        "[default: 1]",
        "[default: 8]",
        "[default: 16G]",
        "at most 16 for each pixel of the picture (at least of 256×256) and at most 4 million]",
    ] {
        assert!(flat.contains(default), "{default} is missing");
    }
}

#[test]
fn wrong_options_are_refused_in_one_message_and_leave_no_file() {
    let place = Workplace::new();
    place.cube();
    place.write("scene.toml", "version = 1\n[[mesh]]\npath = 'cube.obj'\n");
    place.write("empty.toml", "version = 1\n");
    place.write("nonsense.bin", [0, 1, 2, 3]);
    let before = place.files();
    for (args, says) in [
        (&["--eye", "1,2"][..], "1,-2,3.5"),
        (&["--eye", "1,2,nan"], "not finite"),
        (&["--eye", "1,1,1", "--target", "1,1,1"], "must differ"),
        (&["--fov", "0"], "between 0 and 180"),
        (&["--fov", "30", "--orthographic", "3"], "cannot be used with"),
        (&["--orthographic", "-1"], "--orthographic is -1; it must be finite and above 0"),
        (&["--orthographic", "0"], "--orthographic is 0"),
        (&["--low-pass", "-1"], "--low-pass is -1; it must be at least 0"),
        // Before the file is read.
        (&["--low-pass", "1e7", "missing.glb"], "--low-pass is 10000000"),
        (&["--reference", "r2", "--samples", "0", "missing.glb"], "--samples is 0"),
        (&["--iso", "3"], "cube.obj: --iso is for volumes; none is given"),
        (&["--transfer", "grey"], "--transfer is for volumes"),
        (&["--dims", "2x2x2"], "--dims is for volumes"),
        (&["--type", "u8"], "--type is for volumes"),
        (&["--endian", "big"], "--endian is for volumes"),
        (&["--spacing", "1,1,2"], "--spacing is for volumes"),
        (&["--point-color", "height"], "--point-color is for point clouds"),
        (&["--level", "1"], "--level is for splats in several levels"),
        (&["--max-memory", "1x"], "512M or 16G"),
        (&["--spacing", "1,1,0"], "--spacing is 0"),
        (&["--spacing", "-1,1,1"], "--spacing is -1"),
        (&["-o", "same.png", "--stats", "./same.png"], "--output and --stats name one file"),
        (&["--background", "red"], "RRGGBB"),
        (&["--shade", "maybe"], "`on` nor `off`"),
        (&["--footprint", "fine"], "auto, point, affine, exact"),
        (&["--samples", "4"], "--reference r2"),
        (&["--order", "axis-sheets"], "auto, centers, per-pixel, slabs"),
        (&["--slab-thickness", "0"], "--slab-thickness is 0; it must be from 0.001"),
        (&["--slab-thickness", "-1", "missing.glb"], "--slab-thickness is -1"),
        (&["--slab-thickness", "nan"], "--slab-thickness is NaN"),
        (
            &["--slab-thickness", "1", "--order", "centers", "missing.glb"],
            "--slab-thickness is for --order slabs",
        ),
        (&["--slab-thickness", "1", "--order", "per-pixel"], "--slab-thickness is for --order slabs"),
        (&["--show", "normals"], "scene, forms"),
        (&["--tolerance", "0/0"], "--tolerance is NaN; it must be from 0 to 1"),
        (&["--tolerance", "2", "missing.glb"], "--tolerance is 2"),
        (&["--tolerance", "-1/255"], "--tolerance is -0.0039"),
        (&["--tolerance", "small"], "write it as 2/255 or 0.01"),
        (&["--budget", "0", "missing.glb"], "--budget is 0; it must be at least 1"),
        (
            &["--budget", "9", "--level-of-detail", "off", "missing.glb"],
            "--budget is kept by --level-of-detail on",
        ),
        (&["--occlusion", "maybe"], "`on` nor `off`"),
        (&["--interpolation", "maybe"], "`on` nor `off`"),
        (&["--threads", "0"], "from 1 to 1024"),
        (&["--threads", "1000000"], "from 1 to 1024"),
        (&["--repeat", "0"], "at least 1"),
        (&["--surfels", "0"], "above 0"),
        (&["--surfels", "9", "--surfel-spacing", "1"], "cannot be used with"),
        (&["--surfel-spacing", "-1"], "above 0"),
        (&["--surfel-spacing", "1e-9"], "at most 100000000"),
        (&["-o", "picture.jpg"], ".png or .exr"),
        (&["-o", "picture"], ".png or .exr"),
        (&["-o", "picture.exr", "--bits", "16"], "--bits"),
        (&["-o", "nowhere/picture.png"], "cannot write nowhere/picture.png"),
        (&["--stats", "nowhere/stats.json"], "cannot write nowhere/stats.json"),
        (&["missing.glb"], "missing.glb"),
        (&["nonsense.bin"], "nonsense.bin"),
        (&["scene.toml"], "a scene file stands alone"),
        (&["--iso", "1,x"], "not a finite number"),
    ] {
        let message = place.refusal(&[&["render", "cube.obj", "--size", "16x16"], args].concat());
        assert!(message.contains(says), "{args:?}: {message}");
        assert!(message.starts_with("error: "), "{args:?}: {message}");
        assert_eq!(place.files(), before, "{args:?}");
    }
    assert!(place.refusal(&["render", "--size", "10"]).contains("640x480"));
    assert!(place.refusal(&["render", "--size", "0x10"]).contains("--size is 0x10; it must be 1 to 65535"));
    assert!(place.refusal(&["render", "--size", "65535x65535"]).contains("at most"));
    assert!(place.refusal(&["render", "--dims", "2x2x2"]).contains("--dims"));
    assert!(place.refusal(&["info", "cube.obj", "--spacing", "1,1,1"]).contains("--spacing is for volumes"));
    assert!(place.refusal(&["render", "empty.toml"]).contains("[[mesh]]"));
    assert!(place.refusal(&["render", "missing.toml"]).contains("missing.toml"));
    assert_eq!(place.files(), before);
}

#[test]
fn options_that_the_files_have_no_use_for_are_refused() {
    let place = Workplace::new();
    place.ball();
    place.cube();
    let header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 2 2\nencoding: raw\n\n";
    place.write("v.nrrd", [header.as_bytes(), &[0, 0, 0, 0, 9, 9, 9, 9]].concat());
    image::RgbImage::from_pixel(2, 2, image::Rgb([255, 0, 0])).save(place.path("red.png")).unwrap();
    place.write("flat.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n");
    let ball = "ball_16x16x16_uint8.raw";
    for (args, says) in [
        (&[ball, "--surfels", "9"][..], "--surfels is for meshes; none is given"),
        (&[ball, "--surfel-spacing", "9"], "--surfel-spacing is for meshes"),
        (&[ball, "--texture", "red.png"], "--texture is for meshes"),
        (&["cube.obj", "--texture", "red.png"], "--texture is used by no part"),
        (&["v.nrrd", "--dims", "2x2x2"], "v.nrrd: --dims is for raw files; the volume has a header"),
        (&["v.nrrd", "--type", "u8"], "--type is for raw files"),
    ] {
        let message = place.refusal(&[&["render", "--size", "8x8"], args].concat());
        assert!(message.contains(says), "{args:?}: {message}");
    }
    // One file that has a use is enough.
    let small = ["render", "--size", "8x8", "--surfels", "50"];
    place.run(&[&small[..], &["flat.obj", "cube.obj", "--texture", "red.png"]].concat());
    place.run(&[&small[..], &["cube.obj", "v.nrrd", ball, "--dims", "16x16x16", "--iso", "5"]].concat());
}

#[test]
fn presets_are_listed() {
    let place = Workplace::new();
    let [out, err] = place.run(&["render", "--transfer", "list"]);
    assert!(out.lines().count() >= 3 && out.contains("grey"), "{out}");
    assert_eq!(err, "");
    assert!(place.files().is_empty());
}

#[test]
fn an_unknown_transfer_function_is_refused_with_the_presets() {
    let place = Workplace::new();
    place.ball();
    let message = place.refusal(&["render", "ball_16x16x16_uint8.raw", "--transfer", "nosuch"]);
    assert!(message.contains("nosuch") && message.contains("grey"), "{message}");
    place.write("bad.txt", "transfer 1\nstrength loud\n");
    let message = place.refusal(&["render", "ball_16x16x16_uint8.raw", "--transfer", "bad.txt"]);
    assert!(message.contains("bad.txt: line 2"), "{message}");
}

#[test]
fn info_tells_meshes_and_volumes() {
    let place = Workplace::new();
    place.cube();
    place.ball();
    let [mesh, _] = place.run(&["info", "cube.obj"]);
    for says in ["mesh", "triangles   12", "area        24", "bounds      -1, -1, -1 to 1, 1, 1"] {
        assert!(mesh.contains(says), "{says} is missing in {mesh}");
    }
    let [volume, _] = place.run(&["info", "ball_16x16x16_uint8.raw", "--spacing", "1,1,2"]);
    for says in
        ["16×16×16 voxels of u8", "spacing     1, 1, 2", "to 15, 15, 30", "values      0 to ", "--iso "]
    {
        assert!(volume.contains(says), "{says} is missing in {volume}");
    }
    let [plain, _] = place.run(&["info", "ball_16x16x16_uint8.raw", "--dims", "16x16x8", "--type", "u16"]);
    assert!(plain.contains("16×16×8 voxels of u16"), "{plain}");
    let message = place.refusal(&["info", "ball_16x16x16_uint8.raw", "--dims", "16x16x17"]);
    assert!(message.contains("4096") && message.contains("4352"), "{message}");
}

#[test]
fn what_is_read_is_not_written_over() {
    let place = Workplace::new();
    place.cube();
    place.ball();
    place.write("a.tf", "transfer 1\nstrength extinction\ncolor srgb\n0 0 0 0 0\n200 1 1 1 0.2\n");
    let picture = |name: &str| image::GrayImage::new(4, 4).save(place.path(name)).unwrap();
    std::fs::create_dir(place.path("slices")).unwrap();
    for name in ["red.png", "b.png", "slices/1.png", "slices/2.png"] {
        picture(name);
    }
    std::fs::create_dir(place.path("scene")).unwrap();
    place.write("scene/a.toml", "version = 1\n[[mesh]]\npath = '../cube.obj'\ntexture = '../red.png'\n");
    place.run(&["convert", "ball_16x16x16_uint8.raw", "ball.nrrd", "-q"]);
    place.run(&["extract", "ball.nrrd", "--iso", "75", "-o", "ball.ply", "-q"]);
    let contents = || {
        let files = place.files().into_iter().filter(|name| place.path(name).is_file());
        let inner = ["slices/1.png", "slices/2.png", "scene/a.toml"].map(str::to_owned);
        files.chain(inner).map(|name| std::fs::read(place.path(&name)).unwrap()).collect::<Vec<_>>()
    };
    let before = contents();
    for (args, read) in [
        (&["render", "cube.obj", "--texture", "red.png", "-o", "./red.png"][..], "red.png"),
        (&["render", "scene/a.toml", "-o", "red.png"], "scene/../red.png"),
        (&["render", "scene/a.toml", "--stats", "scene/a.toml"], "scene/a.toml"),
        (&["render", "scene/a.toml", "--stats", "cube.obj"], "scene/../cube.obj"),
        (&["render", "ball.nrrd", "--transfer", "a.tf", "--stats", "a.tf"], "a.tf"),
        (&["render", "ball.nrrd", "--color-by", "slices", "--stats", "slices/1.png"], "slices"),
        (&["render", "slices", "-o", "slices/2.png"], "slices"),
        (&["convert", "ball.ply", "ball.ply"], "ball.ply"),
        (&["extract", "ball.nrrd", "--iso", "75", "-o", "a.ply", "--stats", "ball.nrrd"], "ball.nrrd"),
        (&["compare", "red.png", "b.png", "--diff", "b.png"], "b.png"),
    ] {
        let said = place.refusal(args);
        assert!(said.contains(&format!("would overwrite what is read as {read}")), "{args:?}: {said}");
    }
    assert!(before == contents());
    // Beside slices there may be others.
    place.run(&["render", "slices", "-o", "slices/seen.exr", "-q"]);
    place.run(&["render", "slices", "-o", "slices/seen.exr", "-q"]);
}
