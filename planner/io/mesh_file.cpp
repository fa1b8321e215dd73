// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/io/mesh_file.hpp"

#include <assimp/config.h>
#include <assimp/scene.h>

#include <assimp/Importer.hpp>
#include <cstdint>
#include <cstring>

#include "planner/io/ply.hpp"
#include "planner/io/step_importer.hpp"
#include "planner/io/welder.hpp"
#include "planner/io/text_scan.hpp"
#include "planner/io/three_mf.hpp"

namespace asbuilt {

namespace {

std::string extension_of(const std::string& name) {
  const std::size_t dot = name.find_last_of('.');
  std::string e = dot == std::string::npos ? "" : name.substr(dot + 1);
  for (char& c : e) c = c >= 'A' && c <= 'Z' ? char(c + 32) : c;
  return e;
}

tl::unexpected<Refusals> refused(const char* code, const std::string& where, const std::string& message) {
  return refuse({.code = code, .where = where, .message = message, .stage = "input"});
}

bool is_stl_text(std::string_view bytes) {
  std::uint32_t count = 0;
  if (bytes.size() >= 84) std::memcpy(&count, bytes.data() + 80, 4);
  if (bytes.size() >= 84 && bytes.size() == 84 + std::size_t(count) * 50) return false;
  return bytes.substr(0, 5) == "solid" && bytes.substr(0, 2000).find('\0') == std::string_view::npos;
}

/// A binary STL says how many triangles follow; text files start with "solid".
std::optional<Refusals> check_stl(std::string_view bytes, const std::string& name) {
  std::uint32_t count = 0;
  if (bytes.size() >= 84) std::memcpy(&count, bytes.data() + 80, 4);
  if (is_stl_text(bytes)) {
    if (bytes.find("endsolid") == std::string_view::npos)
      return refused("input.mesh_truncated", name, "found an STL text without 'endsolid'; copy or export the file again").value();
    return std::nullopt;
  }
  if (bytes.size() < 84)
    return refused("input.mesh_truncated", name + ": byte " + std::to_string(bytes.size()),
                   "found the end of the file inside the STL header")
        .value();
  if (bytes.size() < 84 + std::size_t(count) * 50)
    return Refusals{{.code = "input.mesh_truncated",
                     .where = name + ": byte " + std::to_string(bytes.size()),
                     .message = "found the end of the file after " + std::to_string((bytes.size() - 84) / 50) + " of " +
                                std::to_string(count) + " triangles, allowed all; copy or export the file again",
                     .measured = double((bytes.size() - 84) / 50),
                     .limit = double(count),
                     .unit = "triangles",
                     .stage = "input"}};
  return std::nullopt;  // bytes after the last triangle are none of ours
}

/// A flat polygon cut into triangles of its own corners, ear by ear; what is left when no ear is found becomes a fan.
std::vector<std::array<std::size_t, 3>> triangles_of(const std::vector<Vec3>& p) {
  std::vector<std::array<std::size_t, 3>> all;
  std::vector<std::size_t> ring(p.size());
  for (std::size_t i = 0; i < p.size(); ++i) ring[i] = i;
  Vec3 n = Vec3::Zero();  // Newell
  for (std::size_t i = 0; i < p.size(); ++i) n += p[i].cross(p[(i + 1) % p.size()]);
  const auto turn = [&](std::size_t a, std::size_t b, std::size_t c) { return (p[b] - p[a]).cross(p[c] - p[b]).dot(n); };
  while (ring.size() > 3 && p.size() <= 300) {
    bool is_cut = false;
    for (std::size_t i = 0; i < ring.size() && !is_cut; ++i) {
      const std::size_t a = ring[(i + ring.size() - 1) % ring.size()], b = ring[i], c = ring[(i + 1) % ring.size()];
      if (!(turn(a, b, c) > 0)) continue;
      is_cut = true;
      for (const std::size_t q : ring)
        if (q != a && q != b && q != c && turn(a, b, q) >= 0 && turn(b, c, q) >= 0 && turn(c, a, q) >= 0) is_cut = false;
      if (!is_cut) continue;
      all.push_back({a, b, c});
      ring.erase(ring.begin() + std::ptrdiff_t(i));
    }
    if (!is_cut) break;
  }
  for (std::size_t i = 1; i + 1 < ring.size(); ++i) all.push_back({ring[0], ring[i], ring[i + 1]});
  return all;
}

/// Nothing in assimp looks whether the corners of a face are there.
bool has_valid_indices(const aiScene& scene) {
  for (unsigned m = 0; m < scene.mNumMeshes; ++m) {
    const aiMesh& mesh = *scene.mMeshes[m];
    for (unsigned f = 0; f < mesh.mNumFaces; ++f)
      for (unsigned k = 0; k < mesh.mFaces[f].mNumIndices; ++k)
        if (mesh.mFaces[f].mIndices[k] >= mesh.mNumVertices) return false;
  }
  return true;
}

MeshFile read_stl_binary(std::string_view bytes, double scale) {
  MeshFile out;
  Welder welder;
  std::uint32_t count = 0;
  std::memcpy(&count, bytes.data() + 80, 4);
  out.mesh.triangles.reserve(count);
  for (std::size_t t = 0; t < count; ++t) {
    std::array<Vec3, 3> corner;
    float v[9];
    std::memcpy(v, bytes.data() + 84 + 50 * t + 12, sizeof v);
    for (std::size_t k = 0; k < 3; ++k) corner[k] = scale * Vec3(v[3 * k], v[3 * k + 1], v[3 * k + 2]);
    welder.add(corner, out);
  }
  return out;
}

Result<MeshFile> read_stl_text(std::string_view bytes, const std::string& name, double scale) {
  MeshFile out;
  Welder welder;
  std::string_view rest = bytes, line;
  std::array<Vec3, 3> corner;
  std::size_t corners = 0;
  int number = 0;
  while (text_scan::take_line(rest, line)) {
    ++number;
    const std::string_view word = text_scan::take_word(line);
    if (word == "vertex") {
      Vec3 v;
      for (int k = 0; k < 3; ++k)
        if (const std::string_view w = text_scan::take_word(line); !text_scan::parse_number(w, v[k]))
          return refused("input.mesh_broken", name + ":" + std::to_string(number),
                         "found " + text_scan::shown_word(w) + ", allowed three numbers with decimal points");
      if (corners == 3)
        return refused("input.mesh_broken", name + ":" + std::to_string(number), "found a facet of more than three corners, allowed three");
      corner[corners++] = scale * v;
    } else if (word == "endfacet") {
      if (corners != 3)
        return refused("input.mesh_broken", name + ":" + std::to_string(number),
                       "found a facet of " + std::to_string(corners) + " corners, allowed three");
      welder.add(corner, out);
      corners = 0;
    } else if (word == "facet") {
      corners = 0;
    }
  }
  if (corners != 0)
    return refused("input.mesh_truncated", name + ":" + std::to_string(number),
                   "found the end of the file inside a facet; copy or export the file again");
  return out;
}

Result<MeshFile> read_ply_mesh(std::string_view bytes, const std::string& name, double scale) {
  auto polygons = read_ply_polygons(bytes, name);
  if (!polygons) {
    Refusals faults = polygons.error();
    for (Refusal& f : faults) f.code = f.code == "input.cloud_truncated" ? "input.mesh_truncated" : "input.mesh_broken";
    return refuse_all(std::move(faults));
  }
  MeshFile out;
  Welder welder;
  std::size_t at = 0;
  std::vector<Vec3> polygon;
  for (const std::uint32_t size : polygons->sizes) {
    polygon.clear();
    for (std::size_t k = 0; k < size; ++k) polygon.push_back(scale * polygons->vertices[polygons->corners[at + k]]);
    at += size;
    if (size < 3) continue;
    for (const auto& t : triangles_of(polygon)) welder.add({polygon[t[0]], polygon[t[1]], polygon[t[2]]}, out);
  }
  return out;
}

void collect(const aiScene& scene, const aiNode& node, const aiMatrix4x4& parent, double scale, Welder& welder, MeshFile& out, int depth) {
  if (depth > 200) return;
  const aiMatrix4x4 T = parent * node.mTransformation;
  for (unsigned m = 0; m < node.mNumMeshes; ++m) {
    if (node.mMeshes[m] >= scene.mNumMeshes) continue;
    const aiMesh& mesh = *scene.mMeshes[node.mMeshes[m]];
    for (unsigned f = 0; f < mesh.mNumFaces; ++f) {
      const aiFace& face = mesh.mFaces[f];
      if (face.mNumIndices < 3) continue;  // points and lines
      std::vector<Vec3> polygon;
      for (unsigned k = 0; k < face.mNumIndices; ++k) {
        const aiVector3D v = T * mesh.mVertices[face.mIndices[k]];
        polygon.push_back(scale * Vec3(v.x, v.y, v.z));
      }
      for (const auto& t : triangles_of(polygon)) welder.add({polygon[t[0]], polygon[t[1]], polygon[t[2]]}, out);
    }
  }
  for (unsigned c = 0; c < node.mNumChildren; ++c) collect(scene, *node.mChildren[c], T, scale, welder, out, depth + 1);
}

Result<MeshFile> read_by_assimp(std::string_view bytes, const std::string& name, const std::string& hint, double mm_per_unit) {
  MeshFile out;
  try {
    Assimp::Importer importer;
    register_step_importer(importer);
    if (hint.empty() || !importer.IsExtensionSupported("." + hint))
      return refused("input.mesh_format", name,
                     "found a file of the format '" + hint.substr(0, 20) + "', allowed STL, PLY, OBJ, 3MF, DAE and what else assimp reads");
    importer.SetPropertyBool(AI_CONFIG_IMPORT_COLLADA_IGNORE_UP_DIRECTION, true);
    const aiScene* scene = importer.ReadFileFromMemory(bytes.data(), bytes.size(), 0, hint.c_str());
    if (!scene || !scene->mRootNode)
      return refused(
          "input.mesh_broken", name,
          std::string("found a file that cannot be read as a mesh (") + std::string(importer.GetErrorString()).substr(0, 200) + ")");
    if (!has_valid_indices(*scene))
      return refused("input.mesh_broken", name, "found a face with a corner that is not in the file; export the mesh again");
    Welder welder;
    collect(*scene, *scene->mRootNode, aiMatrix4x4(), mm_per_unit, welder, out, 0);
  } catch (const std::exception& e) {
    return refused("input.mesh_broken", name, std::string("found a file that cannot be read as a mesh (") + e.what() + ")");
  }
  return out;
}

template <class T>
void put(std::string& bytes, const T& v) {
  bytes.append(reinterpret_cast<const char*>(&v), sizeof v);
}

}  // namespace

std::optional<double> mesh_unit_mm(std::string_view bytes, const std::string& name) {
  const std::string e = extension_of(name);
  if (e == "step" || e == "stp" || e == "p21") return 1.0;  // our importer gives mm
  if (e == "dae") return 1000.0;  // assimp turns the file's unit into metres
  if (e == "3mf") return three_mf_unit_mm(bytes);
  return std::nullopt;
}

Result<MeshFile> read_mesh(std::string_view bytes, const std::string& name, double mm_per_unit) {
  const std::string hint = extension_of(name);
  Result<MeshFile> read = MeshFile{};
  if (hint == "stl") {
    if (auto fault = check_stl(bytes, name)) return refuse_all(std::move(*fault));
    if (is_stl_text(bytes)) read = read_stl_text(bytes, name, mm_per_unit);
    else read = read_stl_binary(bytes, mm_per_unit);
  } else if (is_ply(bytes)) {
    read = read_ply_mesh(bytes, name, mm_per_unit);
  } else if (hint == "3mf") {
    read = read_three_mf(bytes, name, mm_per_unit);
  } else {
    read = read_by_assimp(bytes, name, hint, mm_per_unit);
  }
  if (read && read->mesh.triangles.empty())
    return refused("input.mesh_empty", name, "found a mesh without a single triangle, allowed at least one");
  return read;
}

std::string write_mesh_ply(const Mesh& mesh) {
  std::string bytes = "ply\nformat binary_little_endian 1.0\ncomment mm\nelement vertex " + std::to_string(mesh.vertices.size()) +
                      "\nproperty double x\nproperty double y\nproperty double z\nelement face " + std::to_string(mesh.triangles.size()) +
                      "\nproperty list uchar int vertex_indices\nend_header\n";
  bytes.reserve(bytes.size() + 24 * mesh.vertices.size() + 13 * mesh.triangles.size());
  for (const Vec3& v : mesh.vertices)
    for (int k = 0; k < 3; ++k) put(bytes, v[k]);
  for (const auto& t : mesh.triangles) {
    put(bytes, std::uint8_t(3));
    for (const int i : t) put(bytes, std::int32_t(i));
  }
  return bytes;
}

std::string write_mesh_stl(const Mesh& mesh) {
  std::string bytes(80, ' ');
  std::memcpy(bytes.data(), "mm", 2);
  put(bytes, std::uint32_t(mesh.triangles.size()));
  bytes.reserve(84 + 50 * mesh.triangles.size());
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    const Vec3 n = mesh.triangle_normal(int(t));
    for (int k = 0; k < 3; ++k) put(bytes, float(n[k]));
    for (const int i : mesh.triangles[t])
      for (int k = 0; k < 3; ++k) put(bytes, float(mesh.vertices[std::size_t(i)][k]));
    put(bytes, std::uint16_t(0));
  }
  return bytes;
}

std::string write_cloud_ply(const std::vector<Eigen::Vector3f>& points, const std::vector<Eigen::Vector3f>& normals,
                            const std::vector<float>& sigma) {
  const bool has_normals = !points.empty() && normals.size() == points.size(), has_sigma = !points.empty() && sigma.size() == points.size();
  std::string bytes = "ply\nformat binary_little_endian 1.0\ncomment mm\nelement vertex " + std::to_string(points.size()) +
                      "\nproperty float x\nproperty float y\nproperty float z\n";
  if (has_normals) bytes += "property float nx\nproperty float ny\nproperty float nz\n";
  if (has_sigma) bytes += "property float sigma\n";
  bytes += "end_header\n";
  bytes.reserve(bytes.size() + points.size() * (12 + (has_normals ? 12 : 0) + (has_sigma ? 4 : 0)));
  for (std::size_t i = 0; i < points.size(); ++i) {
    bytes.append(reinterpret_cast<const char*>(points[i].data()), 12);
    if (has_normals) bytes.append(reinterpret_cast<const char*>(normals[i].data()), 12);
    if (has_sigma) put(bytes, sigma[i]);
  }
  return bytes;
}

}  // namespace asbuilt
