// SPDX-License-Identifier: GPL-3.0-or-later
// Meshes: corners become shared vertices, units are applied once, cut files are named, what is written is read.
#include "planner/io/mesh_file.hpp"

#include <gtest/gtest.h>
#include <zlib.h>

#include <filesystem>

#include "planner/io/file.hpp"
#include "tests/unit/io/cloud_text.hpp"

namespace asbuilt {
namespace {

namespace fs = std::filesystem;

Mesh box_mesh(const Vec3& size_mm) {
  Mesh m;
  for (int i = 0; i < 8; ++i) m.vertices.push_back(size_mm.cwiseProduct(Vec3(i & 1 ? 1 : 0, i & 2 ? 1 : 0, i & 4 ? 1 : 0)));
  m.triangles = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4},
                 {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
  return m;
}

double volume_mm3(const Mesh& m) {
  double v = 0;
  for (const auto& t : m.triangles)
    v += m.vertices[std::size_t(t[0])].dot(m.vertices[std::size_t(t[1])].cross(m.vertices[std::size_t(t[2])])) / 6;
  return v;
}

void expect_box(const Result<MeshFile>& read, const Vec3& size_mm) {
  ASSERT_TRUE(read) << read.error()[0].message;
  EXPECT_EQ(read->mesh.vertices.size(), 8u);
  EXPECT_EQ(read->mesh.triangles.size(), 12u);
  EXPECT_NEAR(volume_mm3(read->mesh), size_mm.prod(), 1e-3 * size_mm.prod());
  EXPECT_LT((read->mesh.box().max_mm - size_mm).norm(), 1e-4 * size_mm.norm());
}

std::string stl_text(const Mesh& m) {
  std::string s = "solid box\n";
  for (const auto& t : m.triangles) {
    s += " facet normal 0 0 0\n  outer loop\n";
    for (const int i : t)
      s += "   vertex " + std::to_string(m.vertices[std::size_t(i)].x()) + " " + std::to_string(m.vertices[std::size_t(i)].y()) + " " +
           std::to_string(m.vertices[std::size_t(i)].z()) + "\n";
    s += "  endloop\n endfacet\n";
  }
  return s + "endsolid box\n";
}
std::string obj_text(const Mesh& m) {
  std::string s = "# box\n";
  for (const Vec3& v : m.vertices) s += "v " + std::to_string(v.x()) + " " + std::to_string(v.y()) + " " + std::to_string(v.z()) + "\n";
  for (const auto& t : m.triangles)
    s += "f " + std::to_string(t[0] + 1) + " " + std::to_string(t[1] + 1) + " " + std::to_string(t[2] + 1) + "\n";
  return s;
}

std::string dae_text(const Mesh& m) {
  std::string p, f;
  for (const Vec3& v : m.vertices) p += std::to_string(v.x()) + " " + std::to_string(v.y()) + " " + std::to_string(v.z()) + " ";
  for (const auto& t : m.triangles) f += std::to_string(t[0]) + " " + std::to_string(t[1]) + " " + std::to_string(t[2]) + " ";
  return "<?xml version=\"1.0\"?><COLLADA xmlns=\"http://www.collada.org/2005/11/COLLADASchema\" version=\"1.4.1\"><asset><unit "
         "name=\"millimeter\" meter=\"0.001\"/><up_axis>Y_UP</up_axis></asset><library_geometries><geometry id=\"g\"><mesh><source "
         "id=\"s\"><float_array id=\"a\" count=\"24\">" +
         p +
         "</float_array><technique_common><accessor source=\"#a\" count=\"8\" stride=\"3\"><param name=\"X\" type=\"float\"/><param "
         "name=\"Y\" type=\"float\"/><param name=\"Z\" type=\"float\"/></accessor></technique_common></source><vertices id=\"v\"><input "
         "semantic=\"POSITION\" source=\"#s\"/></vertices><triangles count=\"12\"><input semantic=\"VERTEX\" source=\"#v\" "
         "offset=\"0\"/><p>" +
         f +
         "</p></triangles></mesh></geometry></library_geometries><library_visual_scenes><visual_scene id=\"vs\"><node "
         "id=\"n\"><instance_geometry url=\"#g\"/></node></visual_scene></library_visual_scenes><scene><instance_visual_scene "
         "url=\"#vs\"/></scene></COLLADA>";
}

/// A ZIP archive, entries stored or deflated.
std::string zip(const std::vector<std::pair<std::string, std::string>>& entries, bool is_deflated) {
  std::string body, central;
  for (const auto& [name, text] : entries) {
    std::string data = text;
    if (is_deflated) {
      data.resize(compressBound(uLong(text.size())) + 64);
      z_stream z{};
      deflateInit2(&z, 6, Z_DEFLATED, -MAX_WBITS, 8, Z_DEFAULT_STRATEGY);
      z.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(text.data())), z.avail_in = uInt(text.size());
      z.next_out = reinterpret_cast<Bytef*>(data.data()), z.avail_out = uInt(data.size());
      deflate(&z, Z_FINISH);
      data.resize(z.total_out);
      deflateEnd(&z);
    }
    const auto crc = std::uint32_t(crc32(0, reinterpret_cast<const Bytef*>(text.data()), uInt(text.size())));
    const auto offset = std::uint32_t(body.size());
    const auto common = [&](std::string& to) {
      for (const std::uint16_t v :
           {std::uint16_t(20), std::uint16_t(0), std::uint16_t(is_deflated ? 8 : 0), std::uint16_t(0), std::uint16_t(0x21)})
        test::put(to, v);
      test::put(to, crc), test::put(to, std::uint32_t(data.size())), test::put(to, std::uint32_t(text.size())),
          test::put(to, std::uint16_t(name.size())), test::put(to, std::uint16_t(0));
    };
    body += "PK\3\4";
    common(body);
    body += name + data;
    central += "PK\1\2";
    test::put(central, std::uint16_t(20));
    common(central);
    for (int i = 0; i < 3; ++i) test::put(central, std::uint16_t(0));
    test::put(central, std::uint32_t(0)), test::put(central, offset);
    central += name;
  }
  std::string end = "PK\5\6";
  test::put(end, std::uint32_t(0)), test::put(end, std::uint16_t(entries.size())), test::put(end, std::uint16_t(entries.size())),
      test::put(end, std::uint32_t(central.size())), test::put(end, std::uint32_t(body.size())), test::put(end, std::uint16_t(0));
  return body + central + end;
}
std::string three_mf(const Mesh& m, const std::string& unit, bool is_deflated) {
  std::string model = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<model" + (unit.empty() ? "" : " unit=\"" + unit + "\"") +
                      " xml:lang=\"en-US\" xmlns=\"http://schemas.microsoft.com/3dmanufacturing/core/2015/02\"><resources><object id=\"1\" "
                      "type=\"model\"><mesh><vertices>";
  for (const Vec3& v : m.vertices)
    model += "<vertex x=\"" + std::to_string(v.x()) + "\" y=\"" + std::to_string(v.y()) + "\" z=\"" + std::to_string(v.z()) + "\"/>";
  model += "</vertices><triangles>";
  for (const auto& t : m.triangles)
    model += "<triangle v1=\"" + std::to_string(t[0]) + "\" v2=\"" + std::to_string(t[1]) + "\" v3=\"" + std::to_string(t[2]) + "\"/>";
  model += "</triangles></mesh></object></resources><build><item objectid=\"1\"/></build></model>";
  return zip(
      {{"[Content_Types].xml",
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?><Types xmlns=\"http://schemas.openxmlformats.org/package/2006/content-types\"><Default "
        "Extension=\"rels\" ContentType=\"application/vnd.openxmlformats-package.relationships+xml\"/><Default Extension=\"model\" "
        "ContentType=\"application/vnd.ms-package.3dmanufacturing-3dmodel+xml\"/></Types>"},
       {"_rels/.rels",
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?><Relationships "
        "xmlns=\"http://schemas.openxmlformats.org/package/2006/relationships\"><Relationship Target=\"/3D/3dmodel.model\" Id=\"rel0\" "
        "Type=\"http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel\"/></Relationships>"},
       {"3D/3dmodel.model", model}},
      is_deflated);
}

TEST(Mesh, formats_agree_and_corners_are_welded) {
  const Vec3 size(10, 20, 30);
  const Mesh box = box_mesh(size);
  expect_box(read_mesh(write_mesh_stl(box), "a.stl", 1), size);
  expect_box(read_mesh(write_mesh_ply(box), "a.ply", 1), size);
  expect_box(read_mesh(stl_text(box), "A.STL", 1), size);
  expect_box(read_mesh(obj_text(box), "a.obj", 1), size);
  expect_box(read_mesh(three_mf(box, "millimeter", false), "a.3mf", 1), size);
  expect_box(read_mesh(dae_text(box), "a.dae", mesh_unit_mm(dae_text(box), "a.dae").value()), size);
}

TEST(Mesh, ply_keeps_every_digit) {
  Mesh box = box_mesh({10, 20, 30});
  for (Vec3& v : box.vertices) v += Vec3(1000.0000001, 1.0 / 3, -1e-9);
  const auto read = read_mesh(write_mesh_ply(box), "a.ply", 1);
  ASSERT_TRUE(read);
  for (std::size_t t = 0; t < 12; ++t)
    for (std::size_t k = 0; k < 3; ++k)
      EXPECT_EQ(read->mesh.vertices[std::size_t(read->mesh.triangles[t][k])], box.vertices[std::size_t(box.triangles[t][k])]);
}

TEST(Mesh, units_scale_every_coordinate) {
  const Mesh box = box_mesh({0.01, 0.02, 0.03});
  expect_box(read_mesh(write_mesh_stl(box), "a.stl", 1000), Vec3(10, 20, 30));
}

TEST(Mesh, formats_with_a_unit_say_it) {
  const Mesh box = box_mesh({1, 2, 3});
  EXPECT_EQ(mesh_unit_mm(three_mf(box, "inch", false), "a.3mf"), 25.4);
  EXPECT_EQ(mesh_unit_mm(three_mf(box, "micron", true), "a.3mf"), 0.001);
  EXPECT_EQ(mesh_unit_mm(three_mf(box, "", true), "a.3mf"), 1.0);
  EXPECT_EQ(mesh_unit_mm(write_mesh_stl(box), "a.stl"), std::nullopt);
  EXPECT_EQ(mesh_unit_mm("no archive", "a.3mf"), std::nullopt);
}

TEST(Mesh, polygons_become_triangles) {
  // An L in one face of six corners, its reflex corner first: area 5, whatever the start of the ring.
  const std::vector<std::string> corners{"1 1", "3 1", "3 0", "0 0", "0 3", "1 3"};
  for (std::size_t turn = 0; turn < 6; ++turn) {
    std::string text, face = "f";
    for (std::size_t i = 0; i < 6; ++i) text += "v " + corners[(turn + 6 - i) % 6] + " 2\n", face += " " + std::to_string(i + 1);
    const auto read = read_mesh(text + face + "\n", "l.obj", 1);
    ASSERT_TRUE(read);
    double area_mm2 = 0;
    Vec3 sum = Vec3::Zero();
    for (const auto& t : read->mesh.triangles) {
      const Vec3 c = (read->mesh.vertices[std::size_t(t[1])] - read->mesh.vertices[std::size_t(t[0])])
                         .cross(read->mesh.vertices[std::size_t(t[2])] - read->mesh.vertices[std::size_t(t[0])]);
      area_mm2 += 0.5 * c.norm(), sum += 0.5 * c;
    }
    EXPECT_EQ(read->mesh.triangles.size(), 4u);
    EXPECT_NEAR(area_mm2, 5, 1e-6) << turn;
    EXPECT_NEAR(std::abs(sum.z()), 5, 1e-6) << turn;
  }
}

TEST(Mesh, a_3mf_build_is_put_together) {
  // One box, placed twice: moved by 100 along x, and mirrored at x = 0 inside a component moved by 50 along y.
  const Mesh box = box_mesh({10, 20, 30});
  std::string model = "<model unit=\"millimeter\"><resources><object id=\"1\"><mesh><vertices>";
  for (const Vec3& v : box.vertices)
    model += "<vertex x=\"" + std::to_string(v.x()) + "\" y=\"" + std::to_string(v.y()) + "\" z=\"" + std::to_string(v.z()) + "\"/>";
  model += "</vertices><triangles>";
  for (const auto& t : box.triangles)
    model += "<triangle v1=\"" + std::to_string(t[0]) + "\" v2=\"" + std::to_string(t[1]) + "\" v3=\"" + std::to_string(t[2]) + "\"/>";
  const std::string objects =
      "</triangles></mesh></object><object id=\"2\"><components><component objectid=\"1\" transform=\"-1 0 0 0 1 0 0 0 1 0 50 "
      "0\"/></components></object></resources>";
  const std::string good =
      model + objects + "<build><item objectid=\"1\" transform=\"1 0 0 0 1 0 0 0 1 100 0 0\"/><item objectid=\"2\"/></build></model>";
  const auto read = read_mesh(zip({{"3D/3dmodel.model", good}}, true), "a.3mf", 1);
  ASSERT_TRUE(read) << read.error()[0].message;
  EXPECT_NEAR(volume_mm3(read->mesh), 2 * 6000, 1e-6);
  EXPECT_LT((read->mesh.box().max_mm - Vec3(110, 70, 30)).norm(), 1e-9);
  EXPECT_LT((read->mesh.box().min_mm - Vec3(-10, 0, 0)).norm(), 1e-9);
  for (const char* build : {"<build><item objectid=\"7\"/></build></model>",
                            "<build><item objectid=\"1\" transform=\"1 2 3\"/></build></model>", "</model>", "<build></model>"}) {
    const auto broken = read_mesh(zip({{"3D/3dmodel.model", model + objects + build}}, false), "a.3mf", 1);
    ASSERT_FALSE(broken) << build;
    EXPECT_EQ(broken.error()[0].code, "input.mesh_broken");
  }
}

TEST(Mesh, faults_are_named) {
  const auto code = [](const std::string& bytes, const std::string& name) {
    const auto r = read_mesh(bytes, name, 1);
    return r ? std::string() : r.error()[0].code;
  };
  const std::string stl = write_mesh_stl(box_mesh({1, 2, 3})), ply = write_mesh_ply(box_mesh({1, 2, 3})),
                    text = stl_text(box_mesh({1, 2, 3}));
  for (std::size_t n = 0; n < stl.size(); n += 7) EXPECT_EQ(code(stl.substr(0, n), "a.stl"), "input.mesh_truncated") << n;
  for (std::size_t n = 200; n < ply.size(); n += 7) EXPECT_EQ(code(ply.substr(0, n), "a.ply"), "input.mesh_truncated") << n;
  EXPECT_EQ(code(text.substr(0, text.size() / 2), "a.stl"), "input.mesh_truncated");
  EXPECT_EQ(code("solid nothing\nendsolid nothing\n", "a.stl"), "input.mesh_empty");
  EXPECT_EQ(code("solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nendloop\nendfacet\nendsolid a\n", "a.stl"),
            "input.mesh_broken");
  EXPECT_EQ(code("solid a\nfacet normal 0 0 1\nvertex 0 0 0,5\nendsolid a\n", "a.stl"), "input.mesh_broken");
  EXPECT_EQ(code("solid a\nfacet normal 0 0 1\nvertex 0 0 0\nendsolid a\n", "a.stl"), "input.mesh_truncated");
  EXPECT_EQ(code("ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\nproperty "
                 "list uchar int vertex_index\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n",
                 "a.ply"),
            "input.mesh_broken");
  EXPECT_EQ(
      code("solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 0 0 0\nvertex 0 0 0\nendloop\nendfacet\nendsolid a\n", "a.stl"),
      "input.mesh_empty");
  EXPECT_EQ(code("hello", "a.docx"), "input.mesh_format");
  EXPECT_EQ(code("hello", "noextension"), "input.mesh_format");
  EXPECT_EQ(code("v 0 0 0\n", "a.obj").substr(0, 10), "input.mesh");
  EXPECT_EQ(code("PK nothing", "a.3mf").substr(0, 10), "input.mesh");
}

TEST(Mesh, degenerate_triangles_and_broken_corners_are_counted) {
  Mesh m = box_mesh({1, 1, 1});
  m.triangles.push_back({0, 0, 1});
  m.vertices.emplace_back(std::numeric_limits<double>::quiet_NaN(), 0, 0);
  m.triangles.push_back({0, 8, 1});
  const auto read = read_mesh(write_mesh_stl(m), "a.stl", 1);
  ASSERT_TRUE(read);
  EXPECT_EQ(read->mesh.triangles.size(), 12u);
  EXPECT_EQ(read->degenerate_count + read->dropped_count, 2u);
}

TEST(Mesh, no_bytes_break_the_readers) {
  const Mesh box = box_mesh({1, 2, 3});
  const std::vector<std::pair<std::string, std::string>> files{
      {"a.stl", write_mesh_stl(box)},         {"b.stl", stl_text(box)},
      {"a.ply", write_mesh_ply(box)},         {"a.obj", obj_text(box)},
      {"a.3mf", three_mf(box, "inch", true)}, {"b.3mf", three_mf(box, "inch", false)}};
  std::mt19937_64 engine(5);
  std::size_t read = 0, refused = 0;
  for (int round = 0; round < 200; ++round)
    for (const auto& [name, bytes] : files) {
      const std::string changed = test::mutated(bytes, engine);
      const auto mesh = read_mesh(changed, name, mesh_unit_mm(changed, name).value_or(1));
      ++(mesh ? read : refused);
      if (!mesh) continue;
      for (const Vec3& v : mesh->mesh.vertices) ASSERT_TRUE(v.allFinite());
      for (const auto& t : mesh->mesh.triangles)
        for (const int i : t) ASSERT_TRUE(i >= 0 && std::size_t(i) < mesh->mesh.vertices.size());
    }
  EXPECT_GT(read, 100u);
  EXPECT_GT(refused, 100u);
}

TEST(Mesh, real_meshes_are_read) {
  const fs::path folder = "../shared/data/robots/kuka_kr16_2/meshes/kr16_2";
  if (!fs::exists(folder)) GTEST_SKIP() << "no " << folder;
  const auto size = [&](const char* file, double unit) {
    const auto bytes = read_file(folder / file, file);
    EXPECT_TRUE(bytes);
    const auto mesh = read_mesh(*bytes, file, mesh_unit_mm(*bytes, file).value_or(unit));
    EXPECT_TRUE(mesh);
    return mesh->mesh.box();
  };
  // The drawn and the simplified shape of one link fill about the same box: the unit and the axes of DAE are right.
  const Box3 drawn = size("visual/base_link.dae", 0), simple = size("collision/base_link.stl", 1000);
  EXPECT_LT((drawn.min_mm - simple.min_mm).norm(), 60) << drawn.min_mm.transpose() << " / " << simple.min_mm.transpose();
  EXPECT_LT((drawn.max_mm - simple.max_mm).norm(), 60) << drawn.max_mm.transpose() << " / " << simple.max_mm.transpose();
}

}  // namespace
}  // namespace asbuilt
