// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/io/step_importer.hpp"

#include <assimp/BaseImporter.h>
#include <assimp/importerdesc.h>
#include <assimp/scene.h>

#include <algorithm>
#include <assimp/IOStream.hpp>
#include <assimp/IOSystem.hpp>
#include <assimp/Importer.hpp>
#include <cstring>
#include <map>
#include <memory>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

#include "planner/io/step/step_reader.hpp"

namespace asbuilt {
namespace {

const aiImporterDesc kDescription = {"STEP Importer (exact B-rep)",
                                     "asbuilt",
                                     "asbuilt",
                                     "AP203, AP214, AP242; curved faces as triangles",
                                     aiImporterFlags_SupportTextFlavour,
                                     0,
                                     0,
                                     0,
                                     0,
                                     "step stp p21"};

std::string text_of(Assimp::IOSystem& io, const std::string& file, std::size_t limit) {
  const auto close = [&](Assimp::IOStream* s) { io.Close(s); };
  const std::unique_ptr<Assimp::IOStream, decltype(close)> stream(io.Open(file, "rb"), close);
  if (!stream) return {};
  std::string bytes(std::min(limit, stream->FileSize()), '\0');
  bytes.resize(stream->Read(bytes.data(), 1, bytes.size()));
  return bytes;
}

aiColor4D color_of(const std::string& hex) {
  if (hex.size() != 7) return {0.7f, 0.7f, 0.7f, 1.0f};
  const auto part = [&](std::size_t at) { return static_cast<float>(std::stoi(hex.substr(at, 2), nullptr, 16)) / 255.0f; };
  return {part(1), part(3), part(5), 1.0f};
}

/// The triangles of one body with a vertex for each face around it, so that normals break at edges.
aiMesh* mesh_of(const Brep& b, int body, unsigned material) {
  struct Corner {
    int vertex;
    Vec3 n;
  };
  std::vector<Corner> corners;
  std::vector<std::array<unsigned, 3>> triangles;
  std::map<std::pair<int, int>, unsigned> index;  // face, vertex
  for (std::size_t t = 0; t < b.mesh.triangles.size(); ++t) {
    const int face = b.triangle_face[t];
    const BrepFace& f = b.faces[static_cast<std::size_t>(face)];
    if (f.body != body) continue;
    std::array<unsigned, 3> out{};
    for (std::size_t k = 0; k < 3; ++k) {
      const int v = b.mesh.triangles[t][k];
      const auto [it, is_new] = index.emplace(std::pair{face, v}, static_cast<unsigned>(corners.size()));
      if (is_new) corners.push_back({v, Vec3::Zero()});
      const Vec3 &p = b.mesh.vertices[static_cast<std::size_t>(v)],
                 &q = b.mesh.vertices[static_cast<std::size_t>(b.mesh.triangles[t][(k + 1) % 3])],
                 &r = b.mesh.vertices[static_cast<std::size_t>(b.mesh.triangles[t][(k + 2) % 3])];
      const Vec3 n = (q - p).cross(r - p);
      const double angle = std::atan2(n.norm(), (q - p).dot(r - p));
      if (n.norm() > 0) corners[it->second].n += angle * n.normalized();  // weighted by the angle of the corner
      out[k] = it->second;
    }
    triangles.push_back(out);
  }
  if (triangles.empty()) return nullptr;
  auto mesh = std::make_unique<aiMesh>();
  mesh->mName = b.bodies[static_cast<std::size_t>(body)].id;
  mesh->mPrimitiveTypes = aiPrimitiveType_TRIANGLE;
  mesh->mMaterialIndex = material;
  mesh->mNumVertices = static_cast<unsigned>(corners.size());
  mesh->mVertices = new aiVector3D[corners.size()];
  mesh->mNormals = new aiVector3D[corners.size()];
  for (std::size_t k = 0; k < corners.size(); ++k) {
    const Vec3& p = b.mesh.vertices[static_cast<std::size_t>(corners[k].vertex)];
    const Vec3 n = corners[k].n.norm() > 0 ? Vec3(corners[k].n.normalized()) : Vec3::UnitZ();
    mesh->mVertices[k] = aiVector3D(static_cast<ai_real>(p.x()), static_cast<ai_real>(p.y()), static_cast<ai_real>(p.z()));
    mesh->mNormals[k] = aiVector3D(static_cast<ai_real>(n.x()), static_cast<ai_real>(n.y()), static_cast<ai_real>(n.z()));
  }
  mesh->mNumFaces = static_cast<unsigned>(triangles.size());
  mesh->mFaces = new aiFace[triangles.size()];
  for (std::size_t t = 0; t < triangles.size(); ++t) {
    mesh->mFaces[t].mNumIndices = 3;
    mesh->mFaces[t].mIndices = new unsigned[3];
    std::copy(triangles[t].begin(), triangles[t].end(), mesh->mFaces[t].mIndices);
  }
  return mesh.release();
}

struct Place {  // a node of the assembly
  std::map<std::string, Place> children;
  std::string product;
  std::vector<unsigned> meshes;
};

aiNode* node_of(const std::string& name, const Place& p) {
  auto* node = new aiNode(name);
  node->mNumMeshes = static_cast<unsigned>(p.meshes.size());
  if (!p.meshes.empty()) node->mMeshes = new unsigned[p.meshes.size()];
  std::copy(p.meshes.begin(), p.meshes.end(), node->mMeshes);
  node->mNumChildren = static_cast<unsigned>(p.children.size());
  if (!p.children.empty()) node->mChildren = new aiNode*[p.children.size()];
  unsigned k = 0;
  for (const auto& [key, child] : p.children) {
    node->mChildren[k] = node_of(key, child);
    node->mChildren[k++]->mParent = node;
  }
  return node;
}

class StepImporter : public Assimp::BaseImporter {
 public:
  bool CanRead(const std::string& file, Assimp::IOSystem* io, bool) const override {
    if (!io) return false;
    const std::string head = text_of(*io, file, 65536);
    if (head.substr(0, 4096).find("ISO-10303-21") == std::string::npos) return false;
    const std::size_t schema = head.find("FILE_SCHEMA"), quote = schema == std::string::npos ? schema : head.find('\'', schema);
    return quote == std::string::npos || head.compare(quote + 1, 3, "IFC") != 0;
  }
  const aiImporterDesc* GetInfo() const override { return &kDescription; }

 protected:
  void InternReadFile(const std::string& file, aiScene* scene, Assimp::IOSystem* io) override {
    const auto read = read_step(text_of(*io, file, std::size_t(4) << 30), file);
    if (!read) {
      const Refusal& r = read.error().front();
      throw std::runtime_error(r.code + " " + r.where + ": " + r.message);  // assimp's way to refuse; it becomes GetErrorString()
    }
    const Brep& b = read->artefact;
    std::vector<std::string> colors;
    std::vector<aiMesh*> meshes;
    Place root;
    const int bodies = std::max(1, static_cast<int>(b.bodies.size()));
    for (int body = 0; body < bodies; ++body) {
      const BrepBody& o = b.bodies[static_cast<std::size_t>(body)];
      const auto color = std::find(colors.begin(), colors.end(), o.color);
      const auto material = static_cast<unsigned>(color - colors.begin());
      aiMesh* mesh = mesh_of(b, body, material);
      if (!mesh) continue;
      if (color == colors.end()) colors.push_back(o.color);
      Place* at = &root;
      for (std::size_t from = 0; !o.instance.empty() && from <= o.instance.size();) {
        const std::size_t to = std::min(o.instance.find('/', from), o.instance.size());
        at = &at->children[o.instance.substr(from, to - from)];
        from = to + 1;
      }
      at->product = o.product;
      at->meshes.push_back(static_cast<unsigned>(meshes.size()));
      meshes.push_back(mesh);
    }
    scene->mNumMeshes = static_cast<unsigned>(meshes.size());
    scene->mMeshes = new aiMesh*[meshes.size()];
    std::copy(meshes.begin(), meshes.end(), scene->mMeshes);
    scene->mNumMaterials = static_cast<unsigned>(std::max<std::size_t>(1, colors.size()));
    scene->mMaterials = new aiMaterial*[scene->mNumMaterials];
    for (unsigned k = 0; k < scene->mNumMaterials; ++k) {
      scene->mMaterials[k] = new aiMaterial;
      const aiColor4D c = color_of(k < colors.size() ? colors[k] : "");
      scene->mMaterials[k]->AddProperty(&c, 1, AI_MATKEY_COLOR_DIFFUSE);
    }
    scene->mRootNode = node_of(root.product.empty() ? file : root.product, root);
    scene->mMetaData = aiMetadata::Alloc(2);
    scene->mMetaData->Set(0, "UnitScaleFactor", 0.1);  // mm in cm
    scene->mMetaData->Set(1, "SourceAsset_Format", aiString(b.schema));
  }
};

}  // namespace

void register_step_importer(Assimp::Importer& importer) {
  // Importers are asked in order, and the one for IFC says yes to any Part 21 file: it has to come after ours.
  Assimp::BaseImporter* ifc = importer.GetImporter("stp");
  if (ifc) importer.UnregisterLoader(ifc);
  importer.RegisterLoader(new StepImporter);
  if (ifc) importer.RegisterLoader(ifc);
}

}  // namespace asbuilt
