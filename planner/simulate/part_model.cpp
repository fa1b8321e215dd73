// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/simulate/part_model.hpp"

#include "planner/base/result.hpp"

namespace asbuilt::simulate_detail {
namespace {

PartModel prismatic(const std::string& kind, bool with_lugs, Random& random) {
  const bool is_ring = kind == "ring";
  const Solid nominal = is_ring ? make_ring(true) : make_bracket();
  const Solid real = as_made(is_ring ? make_ring(with_lugs) : nominal, random, 1.0);
  PartModel part;
  part.step = step_text(nominal, kind);
  part.drawn = mesh_of(nominal, 1.0), part.made = mesh_of(real, 2.0);
  part.features = nominal.features;
  part.drawn_edges = worked_edges(nominal, 0.25);
  if (!is_ring || with_lugs) part.made_edges = worked_edges(real, 0.25);
  if (is_ring) {
    part.axis = Vec3::UnitZ();
    part.look_at = Vec3(0, 0, 20), part.support_mm = Vec3(100, 100, 0), part.is_round_support = true;
  } else {
    part.pivot = Vec3(75, 45, 0), part.look_at = Vec3(75, 45, 20);
  }
  return part;
}

PartModel make_one(const std::string& kind, std::uint64_t seed, bool with_lugs) {
  Random random = Random::stream(seed, "as made");
  if (kind == "casting") return make_casting(random);
  if (kind == "freeform") return make_freeform(random);
  return prismatic(kind, with_lugs, random);
}

}  // namespace

const std::vector<std::string>& known_parts() {
  static const std::vector<std::string> parts = {"ring", "bracket", "casting", "freeform"};
  return parts;
}

PartModel make_part(const std::string& kind, std::uint64_t seed, const std::string& made_of, bool with_lugs) {
  PartModel part = make_one(kind, seed, with_lugs);
  if (made_of.empty() || made_of == kind) return part;
  const PartModel other = make_one(made_of, seed, true);
  part.made = other.made;
  for (Vec3& v : part.made.vertices) v += part.pivot - other.pivot;
  part.made_edges.clear();
  return part;
}

}  // namespace asbuilt::simulate_detail
