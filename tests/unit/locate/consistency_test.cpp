// SPDX-License-Identifier: GPL-3.0-or-later
// Probabilities of a sound cell: the tail itself, and what faults do to it.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "planner/fuse/fuse.hpp"
#include "planner/locate/consistency.hpp"
#include "planner/locate/locate.hpp"
#include "tests/unit/locate/synthetic.hpp"

namespace asbuilt {
namespace {

using namespace synthetic;

TEST(Consistency, TailOfChiSquare) {
  // two degrees: exp(-x / 2); one: erfc(sqrt(x / 2))
  for (const double x : {0.01, 0.5, 1.0, 2.9, 3.1, 10.0, 40.0, 200.0}) {
    EXPECT_NEAR(chi_square_tail(x, 2) / std::exp(-x / 2), 1, 1e-10) << x;
    EXPECT_NEAR(chi_square_tail(x, 1) / std::erfc(std::sqrt(x / 2)), 1, 1e-9) << x;
    // from one even number of degrees to the next a term of the Poisson sum is added
    EXPECT_NEAR(chi_square_tail(x, 6) - chi_square_tail(x, 4), std::exp(-x / 2) * std::pow(x / 2, 2) / 2, 1e-12) << x;
  }
  EXPECT_EQ(chi_square_tail(3, 0), 1);
  EXPECT_EQ(chi_square_tail(0, 3), 1);
}

std::string code_of(const Vec3& fault_mm, std::uint64_t seed, Refusal* refusal = nullptr) {
  PartSpec part = make_ring();
  add_feature(part, "lug1", {"top-4", "top-5", "top-6"});
  Job job = make_job(std::move(part), true);
  ScanOptions o;
  o.detail_hand_eye_fault_mm = fault_mm;
  o.seed = seed;
  scan(job, usual_views({{"lug1", Vec3(105, 105, 40)}}, true), o);
  const auto cloud = fuse({}, job);
  if (!cloud) return cloud.error().front().code;
  const auto found = locate({}, job, cloud->artefact);
  if (found) return "";
  if (refusal) *refusal = found.error().front();
  return found.error().front().code;
}

TEST(Consistency, SoundCellsPass) {
  for (std::uint64_t seed = 40; seed < 46; ++seed) EXPECT_EQ(code_of(Vec3::Zero(), seed), "") << seed;
}

TEST(Consistency, AFaultIsLessLikelyTheLargerItIs) {
  double before = 1;
  for (const double size : {0.8, 1.4}) {
    Refusal r;
    ASSERT_EQ(code_of(Vec3(size, size, 0), 41, &r), "locate.captures_contradict") << size;
    EXPECT_EQ(r.unit, "probability");
    EXPECT_LT(r.measured, r.limit);
    EXPECT_LT(r.measured, before);
    before = r.measured;
    EXPECT_NE(r.message.find("sensor"), std::string::npos) << r.message;
  }
}

/// The first detail view taken once more, last of all; of the repeated one every point is moved as if the part had been.
std::string code_with_repeated_view(const Vec3& moved_mm, Refusal* refusal = nullptr) {
  PartSpec part = make_ring();
  add_feature(part, "lug1", {"top-4", "top-5", "top-6"});
  Job job = make_job(std::move(part), true);
  ScanOptions o;
  o.seed = 41;
  std::vector<View> views = usual_views({{"lug1", Vec3(105, 105, 40)}}, true);
  const auto first = std::find_if(views.begin(), views.end(), [](const View& v) { return v.sensor == 1; });
  views.push_back(View(*first));
  scan(job, views, o);
  Capture& last = job.captures.back();
  const auto R = (last.T_base_flange * job.cell.sensors[1].T_flange_sensor).rotation();
  for (Eigen::Vector3f& p : last.points_sensor) p += (R.transpose() * moved_mm).cast<float>();
  const auto cloud = fuse({}, job);
  if (!cloud) return cloud.error().front().code;
  const auto found = locate({}, job, cloud->artefact);
  if (found) return "";
  if (refusal) *refusal = found.error().front();
  return found.error().front().code;
}

TEST(Consistency, APartMovedBetweenTwoViewsIsNamedByBoth) {
  EXPECT_EQ(code_with_repeated_view(Vec3::Zero()), "");
  for (const Vec3& moved : {Vec3(0.35, -0.3, 0), Vec3(0, 0, 0.4)}) {
    Refusal r;
    ASSERT_EQ(code_with_repeated_view(moved, &r), "locate.captures_contradict") << moved.transpose();
    EXPECT_LT(r.measured, r.limit);
    EXPECT_NE(r.message.find("moved between"), std::string::npos) << r.message;
    EXPECT_NE(r.message.find("rarer than once in"), std::string::npos) << r.message;
  }
}

}  // namespace
}  // namespace asbuilt
