// SPDX-License-Identifier: GPL-3.0-or-later
// The same bodies written the ways of many systems: surfaces, curves, senses, seams, units, frames. Volumes, areas and edges have to
// come out as the closed forms say, the mesh closed, no face faulty.
#include "variants.hpp"

#include <gtest/gtest.h>

#include "variants_check.hpp"

namespace asbuilt {
namespace {

using test::Drum;
using test::StepText;
using test::Truth;
using test::Variant;

class Variants : public testing::TestWithParam<Variant> {};
TEST_P(Variants, HasTheTruth) {
  StepText s;
  const Truth t = GetParam().make(s);
  test::expect_truth(s.text(), t);
}

std::vector<Variant> drums() {
  std::vector<Variant> all;
  const auto add = [&](const std::string& name, const Drum& d) {
    all.push_back({name, [d](StepText& s) {
                     int solid = 0;
                     const Truth t = test::add_drum(s, d, 8, 25, solid);
                     s.part({solid});
                     return t;
                   }});
  };
  const std::pair<const char*, Drum::Wall> walls[] = {{"cylinder", Drum::Wall::cylinder},
                                                      {"cylinder with its axis down", Drum::Wall::cylinder_reversed},
                                                      {"extrusion", Drum::Wall::extrusion},
                                                      {"revolution", Drum::Wall::revolution},
                                                      {"rational", Drum::Wall::rational},
                                                      {"rational turned", Drum::Wall::rational_turned},
                                                      {"offset", Drum::Wall::offset},
                                                      {"trimmed", Drum::Wall::trimmed},
                                                      {"curve bounded", Drum::Wall::curve_bounded},
                                                      {"cone of no angle", Drum::Wall::cone}};
  const std::pair<const char*, Drum::Rim> rims[] = {{"circle", Drum::Rim::circle},
                                                    {"circle reversed", Drum::Rim::circle_reversed},
                                                    {"ellipse", Drum::Rim::ellipse},
                                                    {"rational", Drum::Rim::rational},
                                                    {"rational other order", Drum::Rim::rational_other_order},
                                                    {"trimmed", Drum::Rim::trimmed},
                                                    {"surface curve", Drum::Rim::surface_curve},
                                                    {"composite", Drum::Rim::composite},
                                                    {"two arcs", Drum::Rim::two_arcs},
                                                    {"pcurve on the wall", Drum::Rim::pcurve_on_wall},
                                                    {"pcurve on a plane", Drum::Rim::pcurve_on_plane},
                                                    {"surface curve without a course", Drum::Rim::no_course},
                                                    {"arcs of a pcurve", Drum::Rim::pcurve_arcs}};
  for (const auto& [wall_name, wall] : walls)
    for (const bool has_seam : {false, true}) {
      Drum d;
      d.wall = wall, d.has_seam = has_seam;
      add(std::string("drum ") + wall_name + (has_seam ? " seam" : " band"), d);
    }
  for (const auto& [rim_name, rim] : rims)
    for (const Drum::Wall wall : {Drum::Wall::cylinder, Drum::Wall::rational}) {
      Drum d;
      d.rim = rim, d.wall = wall, d.has_seam = wall == Drum::Wall::rational;
      add(std::string("rim ") + rim_name + (d.has_seam ? " on a rational wall" : ""), d);
    }
  for (int k = 0; k < 4; ++k) {
    Drum d;
    d.reversed_bounds = k & 1, d.with_bounds_flagged_outer = k & 2, d.no_ref_direction = true;
    add("bounds " + std::to_string(k), d);
  }
  return all;
}
INSTANTIATE_TEST_SUITE_P(Drum, Variants, testing::ValuesIn(drums()), [](const auto& p) { return test::name_of_variant(p.param.name); });

}  // namespace
}  // namespace asbuilt
