// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/io/mesh_file.hpp"

#include <assimp/config.h>
#include <assimp/postprocess.h>
#include <assimp/scene.h>

#include <assimp/Importer.hpp>
#include <bit>
#include <cstdint>
#include <cstring>
#include <unordered_map>

#include "planner/io/ply.hpp"
#include "planner/io/zip_file.hpp"

namespace asbuilt {

namespace {

std::string extension_of(const std::string& name) {
  const std::size_t dot = name.find_last_of('.');
  std::string e = dot == std::string::npos ? "" : name.substr(dot + 1);
  for (char& c : e) c = c >= 'A' && c <= 'Z' ? char(c + 32) : c;
  return e;
}

tl::unexpected<Refusals> refused(const char* code, const std::string& where, const std::string& message) { return refuse({.code = code, .where = where, .message = message, .stage = "input"}); }

/// A binary STL says how many triangles follow; text files start with "solid".
std::optional<Refusals> check_stl(std::string_view bytes, const std::string& name) {
  std::uint32_t count = 0;
  if (bytes.size() >= 84) std::memcpy(&count, bytes.data() + 80, 4);
  if (bytes.size() >= 84 && bytes.size() == 84 + std::size_t(count) * 50) return std::nullopt;
  const std::string_view head = bytes.substr(0, 5);
  const bool is_text = head == "solid" && bytes.substr(0, 2000).find('\0') == std::string_view::npos;
  if (is_text) {
    if (bytes.find("endsolid") == std::string_view::npos) return refused("input.mesh_truncated", name, "found an STL text without 'endsolid'; copy or export the file again").value();
    return std::nullopt;
  }
  if (bytes.size() < 84) return refused("input.mesh_truncated", name + ": byte " + std::to_string(bytes.size()), "found the end of the file inside the STL header").value();
  if (bytes.size() < 84 + std::size_t(count) * 50)
    return Refusals{{.code = "input.mesh_truncated", .where = name + ": byte " + std::to_string(bytes.size()),
                     .message = "found the end of the file after " + std::to_string((bytes.size() - 84) / 50) + " of " + std::to_string(count) + " triangles, allowed all; copy or export the file again",
                     .measured = double((bytes.size() - 84) / 50), .limit = double(count), .unit = "triangles", .stage = "input"}};
  return std::nullopt;  // bytes after the last triangle are none of ours
}

struct Welder {
  struct Key {
    std::uint64_t x, y, z;
    bool operator==(const Key&) const = default;
  };
  struct Hash {
    std::size_t operator()(const Key& k) const {
      std::uint64_t h = k.x * 0x9E3779B97F4A7C15ull;
      h = (h ^ (h >> 29) ^ k.y) * 0xBF58476D1CE4E5B9ull;
      h = (h ^ (h >> 32) ^ k.z) * 0x94D049BB133111EBull;
      return std::size_t(h ^ (h >> 31));
    }
  };
  std::unordered_map<Key, int, Hash> index;
  Mesh& mesh;
  int at(const Vec3& p) {
    const auto bits = [](double d) { return std::bit_cast<std::uint64_t>(d == 0 ? 0.0 : d); };
    const auto [it, is_new] = index.try_emplace(Key{bits(p.x()), bits(p.y()), bits(p.z())}, int(mesh.vertices.size()));
    if (is_new) mesh.vertices.push_back(p);
    return it->second;
  }
};

void collect(const aiScene& scene, const aiNode& node, const aiMatrix4x4& parent, double scale, Welder& welder, MeshFile& out, int depth) {
  if (depth > 200) return;
  const aiMatrix4x4 T = parent * node.mTransformation;
  for (unsigned m = 0; m < node.mNumMeshes; ++m) {
    if (node.mMeshes[m] >= scene.mNumMeshes) continue;
    const aiMesh& mesh = *scene.mMeshes[node.mMeshes[m]];
    for (unsigned f = 0; f < mesh.mNumFaces; ++f) {
      const aiFace& face = mesh.mFaces[f];
      if (face.mNumIndices != 3) continue;
      std::array<int, 3> triangle{};
      bool is_finite = true;
      std::array<Vec3, 3> corner;
      for (int k = 0; k < 3; ++k) {
        if (face.mIndices[k] >= mesh.mNumVertices) {
          is_finite = false;
          break;
        }
        const aiVector3D v = T * mesh.mVertices[face.mIndices[k]];
        corner[std::size_t(k)] = scale * Vec3(v.x, v.y, v.z);
        is_finite = is_finite && corner[std::size_t(k)].allFinite();
      }
      if (!is_finite) {
        ++out.dropped_count;
        continue;
      }
      for (std::size_t k = 0; k < 3; ++k) triangle[k] = welder.at(corner[k]);
      if (triangle[0] == triangle[1] || triangle[1] == triangle[2] || triangle[2] == triangle[0])
        ++out.degenerate_count;
      else
        out.mesh.triangles.push_back(triangle);
    }
  }
  for (unsigned c = 0; c < node.mNumChildren; ++c) collect(scene, *node.mChildren[c], T, scale, welder, out, depth + 1);
}

template <class T>
void put(std::string& bytes, const T& v) {
  bytes.append(reinterpret_cast<const char*>(&v), sizeof v);
}

}  // namespace

std::optional<double> mesh_unit_mm(std::string_view bytes, const std::string& name) {
  const std::string e = extension_of(name);
  if (e == "dae") return 1000.0;  // assimp turns the file's unit into metres
  if (e == "3mf") {               // an attribute of the model; millimetres where it is absent
    const std::optional<std::string> model = read_zip_entry(bytes, ".model", 1u << 16);
    if (!model) return std::nullopt;
    const std::size_t tag = model->find("<model");
    const std::string head = tag == std::string::npos ? "" : model->substr(tag, model->find('>', tag) - tag);
    const std::size_t unit = head.find(" unit=");
    if (unit == std::string::npos || head.size() < unit + 8) return 1.0;
    const std::string word = head.substr(unit + 7, head.find(head[unit + 6], unit + 7) - unit - 7);
    static constexpr std::pair<std::string_view, double> units[] = {{"micron", 0.001}, {"millimeter", 1}, {"centimeter", 10}, {"inch", 25.4}, {"foot", 304.8}, {"meter", 1000}};
    for (const auto& [name_of_unit, mm] : units)
      if (word == name_of_unit) return mm;
  }
  return std::nullopt;
}

Result<MeshFile> read_mesh(std::string_view bytes, const std::string& name, double mm_per_unit) {
  const std::string hint = extension_of(name);
  if (hint == "stl") {
    if (auto fault = check_stl(bytes, name)) return refuse_all(std::move(*fault));
  } else if (is_ply(bytes)) {
    if (auto points = read_ply_points(bytes, name); !points) {
      Refusals faults = points.error();
      for (Refusal& f : faults) f.code = f.code == "input.cloud_truncated" ? "input.mesh_truncated" : "input.mesh_broken";
      return refuse_all(std::move(faults));
    }
  }
  MeshFile out;
  try {
    Assimp::Importer importer;
    if (hint.empty() || !importer.IsExtensionSupported("." + hint))
      return refused("input.mesh_format", name, "found a file of the format '" + hint.substr(0, 20) + "', allowed STL, PLY, OBJ, 3MF, DAE and what else assimp reads");
    importer.SetPropertyBool(AI_CONFIG_IMPORT_COLLADA_IGNORE_UP_DIRECTION, true);
    importer.SetPropertyInteger(AI_CONFIG_PP_SBP_REMOVE, aiPrimitiveType_POINT | aiPrimitiveType_LINE);
    const aiScene* scene = importer.ReadFileFromMemory(bytes.data(), bytes.size(), aiProcess_Triangulate | aiProcess_SortByPType, hint.c_str());
    if (!scene || !scene->mRootNode) return refused("input.mesh_broken", name, std::string("found a file that cannot be read as a mesh (") + std::string(importer.GetErrorString()).substr(0, 200) + ")");
    Welder welder{{}, out.mesh};
    collect(*scene, *scene->mRootNode, aiMatrix4x4(), mm_per_unit, welder, out, 0);
  } catch (const std::exception& e) {
    return refused("input.mesh_broken", name, std::string("found a file that cannot be read as a mesh (") + e.what() + ")");
  }
  if (out.mesh.triangles.empty()) return refused("input.mesh_empty", name, "found a mesh without a single triangle, allowed at least one");
  return out;
}

std::string write_mesh_ply(const Mesh& mesh) {
  std::string bytes = "ply\nformat binary_little_endian 1.0\ncomment mm\nelement vertex " + std::to_string(mesh.vertices.size()) + "\nproperty double x\nproperty double y\nproperty double z\nelement face " + std::to_string(mesh.triangles.size()) +
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

std::string write_cloud_ply(const std::vector<Eigen::Vector3f>& points, const std::vector<Eigen::Vector3f>& normals, const std::vector<float>& sigma) {
  const bool has_normals = !points.empty() && normals.size() == points.size(), has_sigma = !points.empty() && sigma.size() == points.size();
  std::string bytes = "ply\nformat binary_little_endian 1.0\ncomment mm\nelement vertex " + std::to_string(points.size()) + "\nproperty float x\nproperty float y\nproperty float z\n";
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
