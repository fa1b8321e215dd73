// SPDX-License-Identifier: GPL-3.0-or-later
// What the search and the adjustment need of the drawing: the nearest face to any point with its exact normal, the distance
// to the next sharp edge, samples of the surface, rays. Frame: part.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "planner/artefacts/job.hpp"
#include "planner/geom/distance_grid.hpp"
#include "planner/geom/foot_seeds.hpp"
#include "planner/geom/mesh_query.hpp"
#include "planner/geom/point_grid.hpp"

namespace asbuilt {

struct CadSample {
  Vec3 p_part = Vec3::Zero(), n_part = Vec3::UnitZ();
  int face = -1;
};

struct CadFoot {
  double distance_mm = 0;  // signed, positive outside the material
  Vec3 n_part = Vec3::UnitZ();
  int face = -1;
};

struct CadModel {
  const Brep* brep = nullptr;
  DistanceGrid grid;
  MeshQuery query;
  PointGrid sharp_edges;           // points every 0.5 mm along sharp edges
  std::vector<CadSample> samples;  // of about equal area
  double sample_spacing_mm = 0;
  Vec3 center_part = Vec3::Zero();
  double size_mm = 0;              // diagonal
  std::vector<Vec3> face_centers;  // mean of the face's samples (of its triangles where it has none)
  std::vector<double> face_radii_mm;
  std::shared_ptr<const struct CadFreeSearch> free_search;  // see prepare_free_search; empty until then

  std::vector<std::shared_ptr<const FootSeeds>> feet;  // by face; none where feet have a closed form

  /// Signed distance to the exact surface of the nearest face within reach; none beyond it.
  std::optional<CadFoot> foot(const Vec3& p_part, double reach_mm) const;
};

/// Method: see DistanceGrid; samples by area with a fixed seed.
CadModel make_cad_model(const PartSpec& part, double margin_mm);

}  // namespace asbuilt
