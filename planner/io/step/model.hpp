// SPDX-License-Identifier: GPL-3.0-or-later
// From products to bodies: which bodies the file places, where, and in which units.
#pragma once

#include <string>
#include <vector>

#include "planner/geom/brep.hpp"
#include "planner/io/step/bind.hpp"

namespace asbuilt::step {

struct BodyUse {
  std::int64_t body = 0;                                      // MANIFOLD_SOLID_BREP, ...
  Units units;                                                // of the representation that holds it
  Eigen::Affine3d T_root_body = Eigen::Affine3d::Identity();  // mm; mirrored or scaled only by a transformation operator
  std::string name;                                           // of the product
  std::string instance;                                       // names of the usages from the root, joined by '/'
  std::int64_t representation = 0;                            // that holds it
};

struct Model {
  std::vector<BodyUse> bodies;
  std::vector<BodyUse> tessellated;   // bodies given as triangles, of products without a B-rep
  Units units;                        // of the first representation with a body, else of the first context
  std::vector<std::string> external;  // files the model refers to
  bool is_cut = false;                // more than 100 000 placements: the rest was not followed
};

Units read_units(const Binder& b, std::int64_t context);
Model read_model(Binder& b, std::vector<Unread>& unread);

}  // namespace asbuilt::step
