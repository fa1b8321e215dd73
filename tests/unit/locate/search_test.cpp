// SPDX-License-Identifier: GPL-3.0-or-later
// Laws of the search over all rotations.
#include <gtest/gtest.h>

#include <algorithm>

#include "planner/base/random.hpp"
#include "planner/geom/mesh_brep.hpp"
#include "planner/locate/search.hpp"
#include "tests/support/casting_scans.hpp"

namespace asbuilt {
namespace {

TEST(EvenRotations, leave_no_large_gap) {
  const auto all = even_rotations(2000);
  Random random(3);
  double farthest = 0;
  for (int i = 0; i < 100; ++i) {
    const Eigen::Quaterniond q = Eigen::Quaterniond(random.normal(), random.normal(), random.normal(), random.normal()).normalized();
    double nearest = 10;
    for (const auto& r : all) nearest = std::min(nearest, q.angularDistance(r));
    farthest = std::max(farthest, nearest);
  }
  EXPECT_LT(deg_from_rad(farthest), 20);
}

TEST(FreeSearch, finds_a_casting_with_flash_and_riser_turned_any_way) {
  for (const casting_scans::Part& part : casting_scans::parts()) {
    if (part.name != "asymmetric" && part.name != "near-symmetric") continue;
    Job job;
    job.part.brep = brep_from_mesh(part.drawing);
    job.fixture.play_mm = Vec3::Constant(2000);
    CadModel cad = make_cad_model(job.part, 30.0);
    prepare_free_search(cad);
    if (part.name == "near-symmetric") {  // half a turn about z is in the table
      const Pose<frame::Part, frame::Part> half(Eigen::Quaterniond(0, 0, 0, 1), Vec3::Zero());
      EXPECT_TRUE(std::any_of(cad.free_search->motions.begin(), cad.free_search->motions.end(), [&](const SelfMotion& m) {
        return m.motion.q.angularDistance(half.q) < rad_from_deg(3) && !m.is_exact;
      }));
    }
    const casting_scans::View view = casting_scans::views(5, 500)[10];
    const casting_scans::Scan s = casting_scans::scan(part, view, {});
    const Pose<frame::Base, frame::Sensor> T_base_sensor(quat_from_zyx(2.0, -1.1, 0.7), Vec3(100, -50, 900));
    MeasuredCloud cloud;
    cloud.captures.resize(1);
    for (std::size_t i = 0; i < s.p_sensor.size(); ++i) {
      cloud.p_base.push_back(T_base_sensor.point(s.p_sensor[i])), cloud.n_base.push_back(T_base_sensor.direction(s.n_sensor[i]).cast<float>());
      cloud.sigma_mm.push_back(0.18f), cloud.capture.push_back(0);
    }
    const auto found = find_candidates(cad, make_scene(job, cloud, 3.0, 2.0), job.fixture, {T_base_sensor.p_mm});
    ASSERT_FALSE(found.empty());
    const Pose<frame::Base, frame::Part> truth = T_base_sensor * s.T_sensor_part, best = found.front().T_base_part;
    EXPECT_LT(deg_from_rad(best.q.angularDistance(truth.q)), 5) << part.name;
    EXPECT_LT((best.point(cad.center_part) - truth.point(cad.center_part)).norm(), 5) << part.name;
  }
}

}  // namespace
}  // namespace asbuilt
