// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/bench/step/other_readers.hpp"

#include <CGAL/Constrained_Delaunay_triangulation_2.h>
#include <CGAL/Delaunay_mesh_face_base_2.h>
#include <CGAL/Delaunay_mesh_size_criteria_2.h>
#include <CGAL/Delaunay_mesh_vertex_base_2.h>
#include <CGAL/Delaunay_mesher_2.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>

#include <cctype>
#include <cstdlib>
#include <map>
#include <vector>

#include "planner/io/step/chart.hpp"

namespace asbuilt::bench {
namespace {

struct Value {
  std::string text;
  double number = 0;
  std::vector<Value> items;
};
struct Entity {
  std::string keyword;
  std::vector<Value> parameters;
};

class PlainReader {
 public:
  explicit PlainReader(std::string_view s) : s_(s) {}
  std::map<long long, Entity> entities;
  std::size_t count = 0;

  void run() {
    at_ = s_.find("DATA;");
    if (at_ == std::string_view::npos) return;
    at_ += 5;
    while (skip(), at_ < s_.size() && s_[at_] == '#') {
      ++at_;
      const long long id = std::atoll(word().c_str());
      skip(), ++at_, skip();
      Entity e;
      if (s_[at_] == '(') {  // complex
        e.parameters = list();
      } else {
        e.keyword = word(), skip(), e.parameters = list();
      }
      entities.emplace(id, std::move(e));
      skip();
      if (at_ < s_.size() && s_[at_] == ';') ++at_;
    }
  }

 private:
  void skip() {
    while (at_ < s_.size()) {
      if (std::isspace(static_cast<unsigned char>(s_[at_]))) {
        ++at_;
      } else if (s_.compare(at_, 2, "/*") == 0) {
        at_ = std::min(s_.size(), s_.find("*/", at_) + 2);
      } else {
        break;
      }
    }
  }
  std::string word() {
    std::string w;
    while (at_ < s_.size() &&
           (std::isalnum(static_cast<unsigned char>(s_[at_])) || std::string_view("_.+-").find(s_[at_]) != std::string_view::npos))
      w += s_[at_++];
    return w;
  }
  std::vector<Value> list() {
    std::vector<Value> out;
    ++at_;
    while (skip(), at_ < s_.size() && s_[at_] != ')') {
      if (s_[at_] == ',') {
        ++at_;
        continue;
      }
      out.push_back(value()), ++count;
    }
    if (at_ < s_.size()) ++at_;
    return out;
  }
  Value value() {
    Value v;
    const char c = s_[at_];
    if (c == '(') {
      v.items = list();
    } else if (c == '\'') {
      for (++at_; at_ < s_.size(); ++at_) {
        if (s_[at_] == '\'' && (at_ + 1 >= s_.size() || s_[at_ + 1] != '\'')) break;
        v.text += s_[at_];
        if (s_[at_] == '\'') ++at_;
      }
      ++at_;
    } else if (c == '#') {
      ++at_, v.number = static_cast<double>(std::atoll(word().c_str()));
    } else if (std::isalnum(static_cast<unsigned char>(c)) || c == '.' || c == '-' || c == '+') {
      v.text = word();
      if (std::isdigit(static_cast<unsigned char>(c)) || c == '-' || c == '+') v.number = std::strtod(v.text.c_str(), nullptr);
      if (skip(), at_ < s_.size() && s_[at_] == '(') v.items = list();
    } else {
      v.text = c, ++at_;
    }
    return v;
  }
  std::string_view s_;
  std::size_t at_ = 0;
};

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Structure = CGAL::Triangulation_data_structure_2<CGAL::Delaunay_mesh_vertex_base_2<Kernel>, CGAL::Delaunay_mesh_face_base_2<Kernel>>;
using Cdt = CGAL::Constrained_Delaunay_triangulation_2<Kernel, Structure, CGAL::Exact_predicates_tag>;
using Criteria = CGAL::Delaunay_mesh_size_criteria_2<Cdt>;

/// Parameter steps that keep chord and angle, from second derivatives over the box of the face.
Vec2 steps(const step::Chart& chart, const Vec2& low, const Vec2& high, const step::Tolerance& tol) {
  Vec2 out(1e300, 1e300);
  for (int i = 0; i <= 4; ++i)
    for (int j = 0; j <= 4; ++j) {
      const Vec2 q(low.x() + (high.x() - low.x()) * (i + 0.01) / 4.02, low.y() + (high.y() - low.y()) * (j + 0.01) / 4.02);
      const SurfaceJet k = evaluate_jet(*chart.surface, q.x(), q.y());
      const Vec3 n = k.du.cross(k.dv).normalized();
      const double bend[2] = {std::abs(n.dot(k.duu)), std::abs(n.dot(k.dvv))}, speed[2] = {k.du.norm(), k.dv.norm()};
      for (int a = 0; a < 2; ++a)
        if (bend[a] > 1e-12) out[a] = std::min({out[a], std::sqrt(8 * tol.chord_mm / bend[a]), tol.angle_rad * speed[a] / bend[a]});
    }
  for (int a = 0; a < 2; ++a) out[a] = std::min(out[a], std::max(high[a] - low[a], 1e-9));
  return out;
}

}  // namespace

std::size_t plain_part21(std::string_view bytes) {
  PlainReader r(bytes);
  r.run();
  return r.count;
}

std::size_t refined_by_cgal(step::Body& body, const step::Tolerance& tolerance) {
  std::vector<Vec3> vertices;
  step::sample_edges(body, tolerance, vertices);
  std::size_t triangles = 0;
  for (std::size_t f = 0; f < body.faces.size(); ++f) {
    if (body.faces[f].surface < 0) continue;
    step::FaceChart flat = step::flatten_face(body, static_cast<int>(f), tolerance, vertices);
    if (!flat.fault.empty() || flat.is_whole_surface) continue;
    Vec2 low = Vec2::Constant(1e300), high = Vec2::Constant(-1e300), scale(1, 1);
    for (const auto& l : flat.loops)
      for (const auto& p : l) low = low.cwiseMin(p.q), high = high.cwiseMax(p.q);
    if (flat.chart.is_stereographic) {
      const double r = flat.chart.radius_mm;
      scale = Vec2::Constant(1 / (r * std::min(tolerance.angle_rad, std::sqrt(8 * tolerance.chord_mm / r))));
    } else if (!flat.chart.is_plane) {
      const bool t = flat.chart.is_turned;
      const Vec2 s = t ? steps(flat.chart, {-high.y(), low.x()}, {-low.y(), high.x()}, tolerance) : steps(flat.chart, low, high, tolerance);
      scale = t ? Vec2(1 / s.y(), 1 / s.x()) : Vec2(1 / s.x(), 1 / s.y());
    }
    Cdt cdt;
    for (const auto& l : flat.loops) {
      std::vector<Cdt::Vertex_handle> v;
      for (const auto& p : l) v.push_back(cdt.insert(Kernel::Point_2(p.q.x() * scale.x(), p.q.y() * scale.y())));
      for (std::size_t k = 0; k < v.size(); ++k)
        if (v[k] != v[(k + 1) % v.size()]) cdt.insert_constraint(v[k], v[(k + 1) % v.size()]);
    }
    if (!flat.chart.is_plane && cdt.dimension() == 2) {
      CGAL::Delaunay_mesher_2<Cdt, Criteria> mesher(cdt, Criteria(0, 1.0));
      mesher.refine_mesh();
    }
    triangles += cdt.number_of_faces();
  }
  return triangles;
}

}  // namespace asbuilt::bench
