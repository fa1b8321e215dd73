// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include "planner/base/archive.hpp"
#include "planner/base/number.hpp"
#include "planner/base/random.hpp"
#include "planner/geom/brep.hpp"

namespace asbuilt {
namespace {

TEST(Number, writes_no_negative_zero) {
  EXPECT_EQ(fixed_number(-0.0004, 3), "0.000");
  EXPECT_EQ(fixed_number(-0.0006, 3), "-0.001");
  EXPECT_EQ(shortest_number(-0.0), "0");
  EXPECT_THROW(fixed_number(std::nan(""), 3), Bug);
}

TEST(Hash, matches_the_published_vector) {
  EXPECT_EQ(sha256_hex("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
}

TEST(Pose, disturbed_and_twist_between_are_inverse) {
  Random r(7);
  for (int i = 0; i < 200; ++i) {
    const auto rnd = [&] { return Vec3(r.normal(), r.normal(), r.normal()); };
    const Pose<frame::Base, frame::Part> T(quat_exp(rnd()), 100 * rnd());
    Vec6 xi;
    xi << rnd(), 0.3 * rnd();
    EXPECT_LT((twist_between(T, T.disturbed(xi)) - xi).norm(), 1e-9);
    EXPECT_LT((T.inverse() * T).p_mm.norm(), 1e-9);
  }
}

TEST(Archive, reads_back_what_it_wrote) {
  BrepFace f;
  f.id = "#12";
  f.surface.shape = CylinderSurface{Placement{}, 12.5};
  f.edges = {1, 2, 3};
  const std::string bytes = to_bytes(f);
  EXPECT_EQ(to_bytes(from_bytes<BrepFace>(bytes)), bytes);
  EXPECT_THROW(from_bytes<BrepFace>(bytes.substr(0, bytes.size() - 1)), Bug);
  EXPECT_EQ(to_json(f)["id"], "#12");
}

}  // namespace
}  // namespace asbuilt
