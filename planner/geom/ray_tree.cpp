// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/geom/ray_tree.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace asbuilt {

namespace {

constexpr int kLeaf = 4, kBins = 12;

struct Node {  // children are neighbours: left at `first`, right at `first` + 1
  std::array<float, 3> lo, hi;
  int first = 0;  // of the children, or of the triangles
  int count = 0;  // triangles of a leaf; 0: not a leaf
};

struct Facet {
  Vec3 a, ab, ac;
  int triangle;
};

struct FlatBox {
  Eigen::Array3d lo = Eigen::Array3d::Constant(1e300), hi = Eigen::Array3d::Constant(-1e300);
  void extend(const FlatBox& b) { lo = lo.min(b.lo), hi = hi.max(b.hi); }
  double half_area() const {
    const Eigen::Array3d d = (hi - lo).max(0.0);
    return d[0] * d[1] + d[1] * d[2] + d[2] * d[0];
  }
};

float down(double v) { return std::nextafter(static_cast<float>(v), -std::numeric_limits<float>::infinity()); }
float up(double v) { return std::nextafter(static_cast<float>(v), std::numeric_limits<float>::infinity()); }

}  // namespace

struct RayTree::Impl {
  std::vector<Node> nodes;
  std::vector<Facet> facets;
  Box3 box;

  struct Building {
    std::vector<FlatBox> boxes;
    std::vector<Eigen::Array3d> middles;
    std::vector<int> order;
  };

  void build(Building& b, int node, int begin, int end, int depth) {
    FlatBox all, spread;
    for (int i = begin; i < end; ++i) {
      all.extend(b.boxes[static_cast<std::size_t>(b.order[static_cast<std::size_t>(i)])]);
      const Eigen::Array3d& m = b.middles[static_cast<std::size_t>(b.order[static_cast<std::size_t>(i)])];
      spread.extend({m, m});
    }
    Node& n = nodes[static_cast<std::size_t>(node)];
    for (int k = 0; k < 3; ++k) n.lo[static_cast<std::size_t>(k)] = down(all.lo[k]), n.hi[static_cast<std::size_t>(k)] = up(all.hi[k]);
    const int count = end - begin;
    int axis = 0;
    const Eigen::Array3d width = spread.hi - spread.lo;
    width.maxCoeff(&axis);
    if (count <= kLeaf || width[axis] <= 0 || depth > 60) {
      n.first = begin, n.count = count;
      return;
    }
    // binned surface-area split along the widest axis; the middle of the list where that divides nothing
    std::array<FlatBox, kBins> bin;
    std::array<int, kBins> inside{};
    const auto bin_of = [&](int i) {
      return std::min(kBins - 1, static_cast<int>(kBins * (b.middles[static_cast<std::size_t>(i)][axis] - spread.lo[axis]) / width[axis]));
    };
    for (int i = begin; i < end; ++i) {
      const int t = b.order[static_cast<std::size_t>(i)], k = bin_of(t);
      bin[static_cast<std::size_t>(k)].extend(b.boxes[static_cast<std::size_t>(t)]), ++inside[static_cast<std::size_t>(k)];
    }
    int best = -1;
    double best_cost = 1e300;
    for (int k = 1; k < kBins; ++k) {
      FlatBox left, right;
      int nl = 0, nr = 0;
      for (int j = 0; j < k; ++j) left.extend(bin[static_cast<std::size_t>(j)]), nl += inside[static_cast<std::size_t>(j)];
      for (int j = k; j < kBins; ++j) right.extend(bin[static_cast<std::size_t>(j)]), nr += inside[static_cast<std::size_t>(j)];
      if (nl == 0 || nr == 0) continue;
      const double cost = nl * left.half_area() + nr * right.half_area();
      if (cost < best_cost) best_cost = cost, best = k;
    }
    int middle = begin + count / 2;
    if (best > 0) {
      const auto cut = std::stable_partition(b.order.begin() + begin, b.order.begin() + end, [&](int i) { return bin_of(i) < best; });
      middle = static_cast<int>(cut - b.order.begin());
    }
    const int child = static_cast<int>(nodes.size());
    nodes[static_cast<std::size_t>(node)].first = child;
    nodes.emplace_back(), nodes.emplace_back();
    build(b, child, begin, middle, depth + 1);
    build(b, child + 1, middle, end, depth + 1);
  }

  /// Calls hit(facet, t) for what lies in (from, to); hit returns the new `to`, below `from` to stop.
  template <class Hit>
  void walk(const Vec3& p, const Vec3& d, double from, double to, Hit&& hit) const {
    if (nodes.empty()) return;
    const float px[3] = {static_cast<float>(p.x()), static_cast<float>(p.y()), static_cast<float>(p.z())};
    float inverse[3];
    for (int k = 0; k < 3; ++k) inverse[k] = std::abs(d[k]) > 1e-12 ? static_cast<float>(1.0 / d[k]) : (d[k] < 0 ? -1e12f : 1e12f);
    const float slack = 1e-4f * (1 + std::abs(px[0]) + std::abs(px[1]) + std::abs(px[2]));  // of the rounded origin
    const auto enters = [&](const Node& n, float& t_in) {
      float t0 = static_cast<float>(from) - slack, t1 = static_cast<float>(to) + slack;
      for (int k = 0; k < 3; ++k) {
        const auto i = static_cast<std::size_t>(k);
        float a = (n.lo[i] - slack - px[k]) * inverse[k], b = (n.hi[i] + slack - px[k]) * inverse[k];
        if (a > b) std::swap(a, b);
        t0 = std::max(t0, a), t1 = std::min(t1, b);
      }
      t_in = t0;
      return t0 <= t1;
    };
    int stack[128], top = 0;
    float t_root;
    if (!enters(nodes[0], t_root)) return;
    stack[top++] = 0;
    while (top > 0) {
      const Node& n = nodes[static_cast<std::size_t>(stack[--top])];
      if (n.count > 0) {
        for (int i = n.first; i < n.first + n.count; ++i) {
          const Facet& f = facets[static_cast<std::size_t>(i)];
          const Vec3 q = d.cross(f.ac);
          const double det = f.ab.dot(q);
          if (std::abs(det) < 1e-14) continue;
          const Vec3 s = p - f.a;
          const double u = s.dot(q) / det;
          if (u < -1e-12 || u > 1 + 1e-12) continue;
          const Vec3 r = s.cross(f.ab);
          const double v = d.dot(r) / det;
          if (v < -1e-12 || u + v > 1 + 1e-12) continue;
          const double t = f.ac.dot(r) / det;
          if (t <= from || t >= to) continue;
          to = hit(f, t);
          if (to <= from) return;
        }
        continue;
      }
      float ta, tb;
      const bool has_a = enters(nodes[static_cast<std::size_t>(n.first)], ta), has_b = enters(nodes[static_cast<std::size_t>(n.first) + 1], tb);
      if (has_a && has_b) {  // the nearer one is looked at first
        const bool is_a_first = ta <= tb;
        stack[top++] = n.first + (is_a_first ? 1 : 0);
        stack[top++] = n.first + (is_a_first ? 0 : 1);
      } else if (has_a || has_b) {
        stack[top++] = n.first + (has_b ? 1 : 0);
      }
    }
  }
};

RayTree::RayTree(const Mesh& mesh) {
  auto impl = std::make_shared<Impl>();
  Impl::Building b;
  std::vector<Facet> facets;
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    const auto& f = mesh.triangles[t];
    const Vec3 &a = mesh.vertices[static_cast<std::size_t>(f[0])], &p = mesh.vertices[static_cast<std::size_t>(f[1])],
               &q = mesh.vertices[static_cast<std::size_t>(f[2])];
    if ((p - a).cross(q - a).norm() < 1e-12) continue;
    facets.push_back({a, p - a, q - a, static_cast<int>(t)});
    FlatBox box;
    for (const Vec3* v : {&a, &p, &q}) box.extend({v->array(), v->array()}), impl->box.extend(*v);
    b.boxes.push_back(box);
    b.middles.push_back(0.5 * (box.lo + box.hi));
    b.order.push_back(static_cast<int>(b.order.size()));
  }
  if (!facets.empty()) {
    impl->nodes.reserve(facets.size());
    impl->nodes.emplace_back();
    impl->build(b, 0, 0, static_cast<int>(facets.size()), 0);
    impl->facets.reserve(facets.size());
    for (const int i : b.order) impl->facets.push_back(facets[static_cast<std::size_t>(i)]);
    impl->nodes.shrink_to_fit();
  }
  impl_ = std::move(impl);
}

bool RayTree::is_empty() const { return !impl_ || impl_->facets.empty(); }
Box3 RayTree::box() const { return impl_ ? impl_->box : Box3(); }

bool RayTree::is_blocked(const Vec3& p, const Vec3& d, double from, double to) const {
  bool is_hit = false;
  if (impl_) impl_->walk(p, d, from, to, [&](const Facet&, double) { return is_hit = true, from - 1; });
  return is_hit;
}

std::optional<RayHit> RayTree::first_hit(const Vec3& p, const Vec3& d, double from, double to) const {
  std::optional<RayHit> best;
  if (impl_)
    impl_->walk(p, d, from, to, [&](const Facet& f, double t) {
      best = RayHit{t, f.triangle};
      return t;
    });
  return best;
}

std::size_t RayTree::memory_bytes() const {
  return impl_ ? impl_->nodes.capacity() * sizeof(Node) + impl_->facets.capacity() * sizeof(Facet) : 0;
}

}  // namespace asbuilt
