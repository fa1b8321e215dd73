// SPDX-License-Identifier: GPL-3.0-or-later
// STEP read through Assimp::Importer is what read_step gives, and IFC stays with assimp.
#include "planner/io/step_importer.hpp"

#include <assimp/scene.h>
#include <gtest/gtest.h>

#include <assimp/Importer.hpp>
#include <filesystem>
#include <fstream>

#include "planner/io/step/step_reader.hpp"
#include "tests/unit/step/step_text.hpp"

namespace asbuilt {
namespace {

struct Sums {
  double area_mm2 = 0, volume_mm3 = 0;
  std::size_t triangles = 0;
};
void add(const aiScene& scene, const aiNode& node, Sums& s) {
  for (unsigned m = 0; m < node.mNumMeshes; ++m) {
    const aiMesh& mesh = *scene.mMeshes[node.mMeshes[m]];
    for (unsigned f = 0; f < mesh.mNumFaces; ++f) {
      Vec3 p[3];
      for (int k = 0; k < 3; ++k) {
        const aiVector3D& v = mesh.mVertices[mesh.mFaces[f].mIndices[k]];
        p[k] = {v.x, v.y, v.z};
        const aiVector3D& n = mesh.mNormals[mesh.mFaces[f].mIndices[k]];
        EXPECT_NEAR(n.Length(), 1, 1e-4);
      }
      s.area_mm2 += 0.5 * (p[1] - p[0]).cross(p[2] - p[0]).norm();
      s.volume_mm3 += p[0].dot(p[1].cross(p[2])) / 6;
      ++s.triangles;
    }
  }
  for (unsigned c = 0; c < node.mNumChildren; ++c) add(scene, *node.mChildren[c], s);
}

TEST(StepImporter, GivesThePartAsReadStepDoes) {
  test::StepText s;
  const int box = test::add_box(s, {0, 0, 0}, {30, 20, 10}), drum = test::add_seamless_cylinder(s, 8, 25);
  s.part({box, drum});
  const std::string text = s.text();
  Assimp::Importer importer;
  register_step_importer(importer);
  for (const char* hint : {"step", "stp"}) {
    const aiScene* scene = importer.ReadFileFromMemory(text.data(), text.size(), 0, hint);
    ASSERT_NE(scene, nullptr) << importer.GetErrorString();
    Sums sums;
    add(*scene, *scene->mRootNode, sums);
    const Brep b = read_step(text, "x")->artefact;
    EXPECT_EQ(sums.triangles, b.mesh.triangles.size());
    EXPECT_EQ(scene->mNumMeshes, 2u);
    EXPECT_EQ(std::string(scene->mRootNode->mName.C_Str()), "part");
    EXPECT_NEAR(sums.volume_mm3, 6000 + kPi * 64 * 25, 0.01 * 11000);
    double unit = 0;
    ASSERT_TRUE(scene->mMetaData->Get("UnitScaleFactor", unit));
    EXPECT_EQ(unit, 0.1);
  }
}

TEST(StepImporter, RefusesAsReadStepDoesAndLeavesIfcAlone) {
  Assimp::Importer importer;
  register_step_importer(importer);
  test::StepText s;
  s.point({1, 2, 3});
  const std::string empty = s.text();
  EXPECT_EQ(importer.ReadFileFromMemory(empty.data(), empty.size(), 0, "step"), nullptr);
  EXPECT_NE(std::string(importer.GetErrorString()).find("step.no_body"), std::string::npos) << importer.GetErrorString();
  std::string ifc = empty;
  ifc.replace(ifc.find("AUTOMOTIVE_DESIGN"), 17, "IFC2X3");
  EXPECT_EQ(importer.ReadFileFromMemory(ifc.data(), ifc.size(), 0, "ifc"), nullptr);
  EXPECT_NE(std::string(importer.GetErrorString()).find("IFC"), std::string::npos) << importer.GetErrorString();
  EXPECT_TRUE(importer.IsExtensionSupported("ifc"));
}

TEST(StepImporter, ReadsFilesOfManySystems) {
  const std::filesystem::path root = "../shared/data/step";
  if (!std::filesystem::exists(root)) GTEST_SKIP() << "no ../shared/data/step here";
  for (const char* name :
       {"hoops_two_cars_nested_asm.stp", "occ_red_cube_blue_cylinder.step", "zoo_hex_nut.step", "nist_ctc_01_asme1_rd.stp"}) {
    Assimp::Importer importer;
    register_step_importer(importer);
    const aiScene* scene = importer.ReadFile((root / name).string(), 0);
    ASSERT_NE(scene, nullptr) << importer.GetErrorString();
    std::ifstream in(root / name, std::ios::binary);
    const Brep b = read_step(std::string{std::istreambuf_iterator<char>(in), {}}, name)->artefact;
    Sums sums;
    add(*scene, *scene->mRootNode, sums);
    EXPECT_EQ(sums.triangles, b.mesh.triangles.size()) << name;
    EXPECT_EQ(scene->mNumMeshes, b.bodies.size()) << name;
    EXPECT_NEAR(sums.area_mm2, b.area_mm2, 0.01 * b.area_mm2) << name;
    if (b.bodies[0].instance.empty()) continue;
    EXPECT_GT(scene->mRootNode->mNumChildren, 0u) << name;
  }
}

}  // namespace
}  // namespace asbuilt
