// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/locate/locate.hpp"

#include <gtest/gtest.h>

#include <chrono>
#include <iostream>

#include "planner/fuse/fuse.hpp"
#include "tests/unit/locate/synthetic.hpp"

namespace asbuilt {
namespace {

using namespace synthetic;

struct Ring {
  Job job;
  Truth truth;
};

Job ring_job() {
  PartSpec part = make_ring();
  add_feature(part, "lug1", {"top-4", "top-5", "top-6"});
  add_feature(part, "lug4", {"top-16", "top-17", "top-18"});
  return make_job(std::move(part), true);
}

std::vector<View> ring_views(const Pose<frame::Part, frame::Part>& play) {
  const auto at = [&](double deg) { return play.point(Vec3(148 * std::cos(rad_from_deg(deg)), 148 * std::sin(rad_from_deg(deg)), 40)); };
  return usual_views({{"lug1", at(45)}, {"lug4", at(180)}});
}

double seconds() { return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count(); }

TEST(Locate, finds_a_ring) {
  Job job = ring_job();
  ScanOptions o;
  o.play = {quat_from_zyx(2.1, 0.01, -0.008), Vec3(2, -3, 1)};
  const Truth truth = scan(job, ring_views(o.play), o);
  double t0 = seconds();
  const auto cloud = fuse({}, job);
  ASSERT_TRUE(cloud) << cloud.error()[0].message;
  std::cout << "fuse " << seconds() - t0 << " s, points " << cloud->artefact.p_base.size() << "\n";
  t0 = seconds();
  const auto found = locate({}, job, cloud->artefact);
  std::cout << "locate " << seconds() - t0 << " s\n";
  ASSERT_TRUE(found) << found.error()[0].code << " " << found.error()[0].message;
  const Location& l = found->artefact;
  const Vec3 c(0, 0, 20);
  std::cout << "off " << (l.T_base_part.point(c) - truth.T_base_part.point(c)).norm() << " mm "
            << deg_from_rad(l.T_base_part.q.angularDistance(truth.T_base_part.q)) << " deg\n";
  for (const Note& n : found->notes) std::cout << n.text << "\n";
  for (const auto& h : l.hypotheses) std::cout << h.log_likelihood_ratio << " " << h.inlier_ratio << " " << h.note << "\n";
  for (double s : l.singular_values) std::cout << s << " ";
  std::cout << "\n";
}

}  // namespace
}  // namespace asbuilt
