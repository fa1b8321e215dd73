// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/io/step/model.hpp"

#include <unordered_map>

namespace asbuilt::step {

using namespace p21;

namespace {

bool is_body(std::uint32_t k) {
  return k == K_MANIFOLD_SOLID_BREP || k == K_BREP_WITH_VOIDS || k == K_FACETED_BREP || k == K_SHELL_BASED_SURFACE_MODEL ||
         k == K_FACE_BASED_SURFACE_MODEL;
}

}  // namespace

Model read_model(Binder& b, std::vector<Unread>& unread) {
  Model m;
  const File& f = b.file();
  std::unordered_map<std::int64_t, bool> seen;
  for (const Instance& i : f.instances) {
    const std::uint32_t k = b.key(i);
    if (k != K_ADVANCED_BREP_SHAPE_REPRESENTATION && k != K_SHAPE_REPRESENTATION && k != K_MANIFOLD_SURFACE_SHAPE_REPRESENTATION &&
        k != K_FACETED_BREP_SHAPE_REPRESENTATION)
      continue;
    try {
      const Args a = b.args(i);
      for (std::int64_t id : b.references(i, a.at(1))) {
        const Instance* it = f.find(id);
        if (!it || !(is_body(b.key(*it)) || b.has(*it, K_MANIFOLD_SOLID_BREP)) || seen[id]) continue;
        seen[id] = true;
        BodyUse u;
        u.body = id;
        u.units = read_units(b, b.reference(i, a.at(2)));
        m.bodies.push_back(u);
      }
    } catch (const StepFault& e) {
      unread.push_back({e.entity, static_cast<int>(e.line), e.text()});
    }
  }
  if (!m.bodies.empty()) m.units = m.bodies.front().units;
  return m;
}

}  // namespace asbuilt::step
