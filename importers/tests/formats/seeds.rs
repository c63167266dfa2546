//! Small valid files of every format: what tests change, byte by byte and at random, and what fuzzing begins with.

use crate::common::{as_text, base64, corner_marked, gzip, png, zlib};
use crate::las::{File, some};
use crate::pcd as pcd_files;

/// A file, and those that it names.
pub(crate) struct Seed {
    pub(crate) name: &'static str,
    pub(crate) bytes: Vec<u8>,
    pub(crate) beside: Vec<(&'static str, Vec<u8>)>,
}

fn alone(name: &'static str, bytes: impl Into<Vec<u8>>) -> Seed {
    Seed { name, bytes: bytes.into(), beside: Vec::new() }
}

pub(crate) fn nrrd() -> Vec<Seed> {
    let header = |encoding: &str| {
        format!(
            "NRRD0004\ntype: short\ndimension: 4\nsizes: 1 4 3 2\nendian: big\nencoding: {encoding}\nkinds: list domain domain domain\n\
             space directions: none (1,0,0) (0,1,0) (0,0,1)\nspace origin: (0,0,0)\nline skip: 1\nbyte skip: 0\n\n\n"
        )
    };
    let samples: Vec<u8> = corner_marked().iter().flat_map(|&s| i16::from(s).to_be_bytes()).collect();
    vec![
        alone("a.nrrd", [header("raw").into_bytes(), samples.clone()].concat()),
        alone("a.nrrd", [header("gzip").into_bytes(), gzip(&samples)].concat()),
        alone("a.nrrd", header("ascii") + &as_text()),
    ]
}

pub(crate) fn vti() -> Vec<Seed> {
    let file = |array: &str, compressor: &str| {
        format!(
            "<VTKFile type=\"ImageData\" header_type=\"UInt64\" {compressor}><ImageData WholeExtent=\"0 3 0 2 0 1\" Origin=\"0 0 0\" \
             Spacing=\"1 1 1\" Direction=\"1 0 0 0 1 0 0 0 1\"><Piece Extent=\"0 3 0 2 0 1\"><PointData Scalars=\"a\">\
             <DataArray type=\"UInt8\" Name=\"a\" NumberOfComponents=\"1\" {array}</DataArray></PointData></Piece></ImageData>"
        )
    };
    let block = zlib(&corner_marked());
    let numbers = [1, 24, 24, block.len()].map(|n| (n as u64).to_le_bytes()).concat();
    let zlib = "compressor=\"vtkZLibDataCompressor\"";
    let inline = format!("format=\"binary\">{}{}", base64(&numbers), base64(&block));
    let appended = file("format=\"appended\" offset=\"0\">", zlib) + "<AppendedData encoding=\"raw\">_";
    let ascii = format!("format=\"ascii\">{}", as_text());
    vec![
        alone("a.vti", file(&inline, zlib) + "</VTKFile>"),
        alone("a.vti", [appended.into_bytes(), numbers, block].concat()),
        alone("a.vti", file(&ascii, "") + "</VTKFile>"),
    ]
}

pub(crate) fn meta_image() -> Vec<Seed> {
    let header = |rest: &str| {
        format!(
            "ObjectType = Image\nNDims = 3\nDimSize = 4 3 2\nOffset = 1 2 3\nTransformMatrix = 0 1 0 0 0 1 1 0 0\n\
             ElementSpacing = 1 -2 3\nElementType = MET_UCHAR\n{rest}\n"
        )
    };
    let packed = zlib(&corner_marked());
    let local =
        format!("CompressedData = True\nCompressedDataSize = {}\nElementDataFile = LOCAL", packed.len());
    let raw = || vec![("a.raw", corner_marked())];
    vec![
        alone("a.mha", [header(&local).into_bytes(), packed].concat()),
        alone("a.mha", header("BinaryData = False\nElementDataFile = LOCAL") + &as_text()),
        Seed {
            name: "a.mhd",
            bytes: header("HeaderSize = -1\nElementDataFile = a.raw").into(),
            beside: raw(),
        },
        Seed {
            name: "a.mhd",
            bytes: header("HeaderSize = 12\nElementDataFile = LIST 2\na.raw\na.raw").into(),
            beside: raw(),
        },
    ]
}

pub(crate) fn nifti() -> Vec<Seed> {
    let [first, second] = [1, 2].map(|version| crate::nifti::example(version, &corner_marked()));
    let packed = gzip(&second);
    let (header, samples) = crate::nifti::pair(&first);
    vec![
        alone("a.nii", first),
        alone("a.nii", second),
        alone("a.nii.gz", packed),
        Seed { name: "a.hdr", bytes: header, beside: vec![("a.img", samples)] },
    ]
}

pub(crate) fn vtk() -> Vec<Seed> {
    let binary = crate::vtk::legacy("BINARY", &corner_marked());
    let rectilinear = crate::vtk::rectilinear_legacy();
    vec![
        alone("a.vtk", binary),
        alone("a.vtk", crate::vtk::legacy("ASCII", as_text().as_bytes())),
        alone("a.vtk", rectilinear),
        alone("a.vtr", crate::vtk::rectilinear_xml()),
        alone("a.vtk", crate::vtk::structured_legacy("BINARY")),
        alone("a.vtk", crate::vtk::structured_legacy("ASCII")),
        alone("a.vtk", crate::vtk::unstructured("3.0")),
        alone("a.vtk", crate::vtk::unstructured("5.1")),
        alone("a.vts", crate::vtk::structured_xml()),
    ]
}

pub(crate) fn plot3d() -> Vec<Seed> {
    let [points, flow] = crate::plot3d::pair();
    vec![
        Seed { name: "a.x", bytes: points.clone(), beside: vec![("a.q", flow.clone())] },
        Seed { name: "a.q", bytes: flow, beside: vec![("a.x", points)] },
    ]
}

pub(crate) fn raw() -> Vec<Seed> {
    vec![alone("a_4x3x2_u8.raw.gz", gzip(&corner_marked()))]
}

pub(crate) fn ply() -> Vec<Seed> {
    let header = |encoding: &str| {
        format!(
            "ply\nformat {encoding} 1.0\ncomment TextureFile a.png\nelement vertex 3\nproperty float x\nproperty float y\n\
             property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nelement face 1\n\
             property list uchar int vertex_indices\nproperty list uchar float texcoord\nend_header\n"
        )
    };
    let vertices = [[0.0_f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let mut binary = header("binary_little_endian").into_bytes();
    for vertex in vertices {
        binary.extend(vertex.iter().flat_map(|c| c.to_le_bytes()));
        binary.extend([255, 128, 0]);
    }
    binary.push(3);
    binary.extend([0_i32, 1, 2].iter().flat_map(|i| i.to_le_bytes()));
    binary.push(6);
    binary.extend([0.0_f32, 0.0, 1.0, 0.0, 0.0, 1.0].iter().flat_map(|c| c.to_le_bytes()));
    let rows = "0 0 0 255 128 0\n1 0 0 255 128 0\n0 1 0 255 128 0\n3 0 1 2 6 0 0 1 0 0 1\n";
    let beside = || vec![("a.png", png())];
    vec![
        Seed { name: "a.ply", bytes: binary, beside: beside() },
        Seed { name: "a.ply", bytes: (header("ascii") + rows).into_bytes(), beside: beside() },
    ]
}

pub(crate) fn splats() -> Vec<Seed> {
    let encodings = ["ascii", "binary_little_endian", "binary_big_endian"];
    encodings.map(|encoding| alone("a.ply", crate::splats::example(encoding))).into()
}

pub(crate) fn packed() -> Vec<Seed> {
    vec![alone("a.compressed.ply", crate::packed::example())]
}

pub(crate) fn splat() -> Vec<Seed> {
    vec![alone("a.splat", crate::splat::example())]
}

pub(crate) fn gltf() -> Vec<Seed> {
    vec![
        alone("a.glb", crate::gltf::example_glb()),
        Seed { name: "a.gltf", bytes: crate::gltf::example_gltf(), beside: vec![("a.png", png())] },
    ]
}

pub(crate) fn gltf_splats() -> Vec<Seed> {
    vec![alone("a.glb", crate::gltf_splats::example_glb())]
}

#[cfg(feature = "meshopt")]
pub(crate) fn gltf_packed() -> Vec<Seed> {
    vec![alone("a.glb", crate::gltf_packed::example_glb())]
}

pub(crate) fn stl() -> Vec<Seed> {
    vec![alone("a.stl", crate::stl::binary()), alone("a.stl", crate::stl::ascii())]
}

pub(crate) fn obj() -> Vec<Seed> {
    let text = "mtllib a.mtl\nv 0 0 0 1 0.5 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nvt 0 0\nvt 1 1\nvn 0 0 1\nusemtl a\n\
        f 1/1/1 2/1/1 3/2/1 4/2/1\nf -1//-1 -2//-1 -3//-1\n";
    let library = b"newmtl a\nKd 1 0.5 0\nd 0.5\nmap_Kd -clamp on -o 0 0 0 -mm 0 1 a.png\n".to_vec();
    vec![Seed { name: "a.obj", bytes: text.into(), beside: vec![("a.mtl", library), ("a.png", png())] }]
}

pub(crate) fn tiff() -> Vec<Seed> {
    vec![alone("a.tif", crate::tiff::example()), alone("a.tif", crate::tiff::ome_example())]
}

pub(crate) fn dicom() -> Vec<Seed> {
    let of = crate::dicom::Slice::seeds();
    of.into_iter().map(|bytes| alone("a.dcm", bytes)).collect()
}

pub(crate) fn surfels() -> Vec<Seed> {
    vec![alone("a.ply", crate::surfels::example())]
}

pub(crate) fn spz() -> Vec<Seed> {
    crate::spz::examples().into_iter().map(|file| alone("a.spz", file)).collect()
}

pub(crate) fn ksplat() -> Vec<Seed> {
    vec![alone("a.ksplat", crate::ksplat::example())]
}

pub(crate) fn sog() -> Vec<Seed> {
    crate::sog::examples()
}

pub(crate) fn las() -> Vec<Seed> {
    let file = |minor, format| File { minor, format, extra: 1, chunk: None, points: some(3) };
    vec![alone("a.las", file(2, 3).bytes()), alone("a.las", file(4, 7).bytes())]
}

pub(crate) fn laz_pointwise() -> Vec<Seed> {
    let file = File { minor: 1, format: 2, extra: 1, chunk: Some(2), points: some(3) };
    vec![alone("a.laz", file.bytes())]
}

pub(crate) fn laz_layered() -> Vec<Seed> {
    let file = File { minor: 4, format: 7, extra: 0, chunk: Some(4), points: some(4) };
    vec![alone("a.laz", file.bytes())]
}

pub(crate) fn pcd() -> Vec<Seed> {
    let files = [pcd_files::ascii().into_bytes(), pcd_files::binary(), pcd_files::compressed()];
    files.into_iter().map(|bytes| alone("a.pcd", bytes)).collect()
}

pub(crate) fn xyz() -> Vec<Seed> {
    let pts = "2\n1 2 3 -500 255 128 2\n2 2 2 7 0 0 0\n";
    vec![alone("a.xyz", "x y z\n0 1 2\n# a\n3, 4;5\n"), alone("a.pts", pts)]
}

pub(crate) fn points() -> Vec<Seed> {
    vec![alone("a.ply", crate::ply::points("ascii")), alone("a.ply", crate::ply::points("binary_big_endian"))]
}
