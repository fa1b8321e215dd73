// SPDX-License-Identifier: GPL-3.0-or-later
// Products own representations, representations hold bodies; usages place products in products. Saved views and other drawings,
// which map the part once more, are never followed.
#include "planner/io/step/model.hpp"

#include <algorithm>
#include <map>
#include <set>
#include <unordered_map>
#include <unordered_set>

namespace asbuilt::step {

using namespace p21;

namespace {

constexpr std::size_t kBodiesLimit = 100'000;
constexpr int kDepthLimit = 64;

class ModelReader {
 public:
  ModelReader(Binder& b, std::vector<Unread>& unread) : b_(b), f_(b.file()), unread_(unread) {}

  Model run() {
    collect();
    for (std::int64_t pd : definitions_in_order_)
      if (!is_child_.count(pd)) walk(pd, Eigen::Affine3d::Identity(), 0, "");
    if (model_.bodies.empty() && model_.tessellated.empty())  // every product is a part of another: a circle
      for (std::int64_t pd : definitions_in_order_)
        if (model_.bodies.empty()) walk(pd, Eigen::Affine3d::Identity(), 0, "");
    for (std::int64_t rep : representations_)  // bodies outside any product
      if (!visited_.count(rep)) {
        seen_here_.clear();
        gather(rep, Eigen::Affine3d::Identity(), {}, 0, true);
      }
    if (model_.bodies.empty() && loose_.empty() && model_.tessellated.empty())  // bodies no representation holds
      for (const Instance& i : f_.instances)
        if (i.record_count > 0 && is_body(i) && model_.bodies.size() < kBodiesLimit)
          model_.bodies.push_back({i.id, {}, Eigen::Affine3d::Identity(), "", "", 0});
    if (model_.bodies.empty()) model_.bodies = std::move(loose_);
    if (!model_.bodies.empty())
      model_.units = model_.bodies.front().units;
    else if (!model_.tessellated.empty())
      model_.units = model_.tessellated.front().units;
    return std::move(model_);
  }

 private:
  struct Usage {
    std::int64_t child = 0;
    std::string name;
    Eigen::Affine3d T = Eigen::Affine3d::Identity();
  };

  static bool is_drawing(std::uint32_t k) {
    return k == K_DRAUGHTING_MODEL || k == K_MECHANICAL_DESIGN_GEOMETRIC_PRESENTATION_REPRESENTATION ||
           k == K_CONSTRUCTIVE_GEOMETRY_REPRESENTATION || k == K_SHAPE_REPRESENTATION_WITH_PARAMETERS ||
           k == K_SHAPE_DIMENSION_REPRESENTATION;
  }
  bool is_body(const Instance& i) const {
    switch (b_.key(i)) {
      case K_MANIFOLD_SOLID_BREP:
      case K_BREP_WITH_VOIDS:
      case K_FACETED_BREP:
      case K_SHELL_BASED_SURFACE_MODEL:
      case K_FACE_BASED_SURFACE_MODEL:
        return true;
      default:
        return i.record_count > 1 && b_.has(i, K_MANIFOLD_SOLID_BREP);
    }
  }
  /// Shells and faces without a body around them: used only when the file has no body.
  static bool is_loose(std::uint32_t k) { return k == K_CLOSED_SHELL || k == K_OPEN_SHELL || k == K_ADVANCED_FACE || k == K_FACE_SURFACE; }
  static bool is_triangles(std::uint32_t k) {
    return k == K_TESSELLATED_SOLID || k == K_TESSELLATED_SHELL || k == K_TRIANGULATED_FACE || k == K_COMPLEX_TRIANGULATED_FACE;
  }

  template <class F>
  void guarded(const F& f) {
    try {
      f();
    } catch (const StepFault& e) {
      if (unread_.size() < 1000) unread_.push_back({e.entity, static_cast<int>(e.line), e.text()});
    }
  }

  std::int64_t related(const Instance& i) const { return b_.reference(i, b_.args(i).at(4)); }

  /// Name, items, context of a representation, simple or complex.
  Args representation(const Instance& i) const {
    Args a = b_.args(i);
    if (i.record_count > 1) {
      const Args r = b_.args(i, K_REPRESENTATION);
      if (r.size()) a = r;
    }
    return a;
  }

  /// Product definition behind a PRODUCT_DEFINITION_SHAPE, 0 when it belongs to something else.
  std::int64_t definition_of(std::int64_t shape) const {
    const Instance* i = f_.find(shape);
    if (!i || (b_.key(*i) != K_PRODUCT_DEFINITION_SHAPE && b_.key(*i) != K_PROPERTY_DEFINITION)) return 0;
    const Value* v = b_.args(*i).at(2);
    return v && v->kind == Kind::reference ? v->integer : 0;
  }

  void collect() {
    std::vector<const Instance*> contextual, usages;
    for (const Instance& i : f_.instances) {
      if (i.record_count == 0) continue;
      const std::uint32_t k = b_.key(i);
      switch (k) {
        case K_PRODUCT_DEFINITION:
        case K_PRODUCT_DEFINITION_WITH_ASSOCIATED_DOCUMENTS:
          definitions_in_order_.push_back(i.id);
          break;
        case K_SHAPE_DEFINITION_REPRESENTATION:
          guarded([&] {
            const Args a = b_.args(i);
            const std::int64_t pd = definition_of(b_.reference(i, a.at(0))), rep = b_.reference(i, a.at(1));
            const Instance* p = f_.find(pd);
            if (p && (b_.key(*p) == K_PRODUCT_DEFINITION || b_.key(*p) == K_PRODUCT_DEFINITION_WITH_ASSOCIATED_DOCUMENTS))
              owned_[pd].push_back(rep), owner_.emplace(rep, pd);
          });
          break;
        case K_CONTEXT_DEPENDENT_SHAPE_REPRESENTATION:
          contextual.push_back(&i);
          break;
        case K_NEXT_ASSEMBLY_USAGE_OCCURRENCE:
          usages.push_back(&i);
          break;
        case K_DOCUMENT_FILE:
          guarded([&] { model_.external.push_back(b_.text(b_.args(i).at(0))); });
          break;
        case K_SHAPE_REPRESENTATION_RELATIONSHIP:
          if (i.record_count == 1)
            guarded([&] {
              const Args a = b_.args(i);
              link(b_.reference(i, a.at(2)), b_.reference(i, a.at(3)));
            });
          break;
        case K_ADVANCED_BREP_SHAPE_REPRESENTATION:
        case K_FACETED_BREP_SHAPE_REPRESENTATION:
        case K_MANIFOLD_SURFACE_SHAPE_REPRESENTATION:
        case K_GEOMETRICALLY_BOUNDED_SURFACE_SHAPE_REPRESENTATION:
        case K_TESSELLATED_SHAPE_REPRESENTATION:
        case K_SHAPE_REPRESENTATION:
          representations_.push_back(i.id);
          break;
        default:
          if (i.record_count > 1) {
            if (b_.has(i, K_SHAPE_REPRESENTATION_RELATIONSHIP) && !b_.has(i, K_REPRESENTATION_RELATIONSHIP_WITH_TRANSFORMATION)) {
              guarded([&] {
                const Args a = b_.args(i, K_REPRESENTATION_RELATIONSHIP);
                link(b_.reference(i, a.at(2)), b_.reference(i, a.at(3)));
              });
            } else if (b_.has(i, K_SHAPE_REPRESENTATION) || b_.has(i, K_ADVANCED_BREP_SHAPE_REPRESENTATION)) {
              bool drawing = false;
              for (std::uint32_t d : {K_DRAUGHTING_MODEL, K_CONSTRUCTIVE_GEOMETRY_REPRESENTATION, K_SHAPE_REPRESENTATION_WITH_PARAMETERS})
                drawing = drawing || b_.has(i, d);
              if (!drawing) representations_.push_back(i.id);
            }
          }
      }
    }
    std::unordered_set<std::int64_t> placed;
    for (const Instance* i : contextual) guarded([&] { contextual_usage(*i, placed); });
    for (const Instance* i : usages)
      guarded([&] {
        if (placed.count(i->id)) return;
        const std::int64_t parent = b_.reference(*i, b_.args(*i).at(3)), child = related(*i);
        usages_[parent].push_back({child, usage_name(*i), Eigen::Affine3d::Identity()});
        is_child_.insert(child);
      });
  }

  void link(std::int64_t a, std::int64_t b) {
    links_[a].push_back(b);
    links_[b].push_back(a);
  }

  /// True when the representation belongs to the product definition, by its own definition or over plain relationships.
  bool belongs(std::int64_t rep, std::int64_t pd) const {
    std::vector<std::int64_t> stack{rep};
    std::set<std::int64_t> seen{rep};
    while (!stack.empty() && seen.size() < 1000) {
      const std::int64_t r = stack.back();
      stack.pop_back();
      const auto o = owner_.find(r);
      if (o != owner_.end() && o->second == pd) return true;
      const auto l = links_.find(r);
      if (l != links_.end())
        for (std::int64_t n : l->second)
          if (seen.insert(n).second) stack.push_back(n);
    }
    return false;
  }

  bool holds(std::int64_t rep, std::int64_t item) const {
    const Instance* i = f_.find(rep);
    if (!i) return false;
    const Args a = representation(*i);
    if (!a.at(1) || a.at(1)->kind != Kind::list) return false;
    const std::vector<std::int64_t> items = b_.references(*i, a.at(1));
    return std::find(items.begin(), items.end(), item) != items.end();
  }

  Units units_of(std::int64_t rep) {
    const auto it = units_.find(rep);
    if (it != units_.end()) return it->second;
    Units u;
    if (const Instance* i = f_.find(rep)) {
      const Value* c = representation(*i).at(2);
      if (c && c->kind == Kind::reference) u = read_units(b_, c->integer);
    }
    units_.emplace(rep, u);
    return u;
  }

  Eigen::Affine3d axes(std::int64_t id, std::int64_t rep) {
    b_.units = units_of(rep);
    const Instance& i = b_.instance(id);
    Eigen::Affine3d T = Eigen::Affine3d::Identity();
    if (b_.has(i, K_CARTESIAN_TRANSFORMATION_OPERATOR_3D)) return b_.transformation(id);
    const Placement p = b_.placement(id);
    T.linear().col(0) = p.x, T.linear().col(1) = p.y, T.linear().col(2) = p.z;
    T.translation() = p.origin;
    return T;
  }

  void contextual_usage(const Instance& i, std::unordered_set<std::int64_t>& placed) {
    const Args a = b_.args(i);
    const Instance& relation = b_.instance(b_.reference(i, a.at(0)));
    const std::int64_t usage_id = definition_of(b_.reference(i, a.at(1)));
    const Instance& usage = b_.instance(usage_id);
    if (b_.key(usage) != K_NEXT_ASSEMBLY_USAGE_OCCURRENCE) return;
    const std::int64_t parent = b_.reference(usage, b_.args(usage).at(3)), child = related(usage);
    placed.insert(usage_id);
    is_child_.insert(child);
    Usage u;
    u.child = child, u.name = usage_name(usage);
    const Args with = b_.args(relation, K_REPRESENTATION_RELATIONSHIP_WITH_TRANSFORMATION);
    Args base = b_.args(relation, K_REPRESENTATION_RELATIONSHIP);
    if (base.size() < 4) base = b_.args(relation);
    if (with.size()) {
      const std::int64_t rep_1 = b_.reference(relation, base.at(2)), rep_2 = b_.reference(relation, base.at(3));
      const Instance& t = b_.instance(b_.reference(relation, with.at(with.size() - 1)));
      if (b_.key(t) == K_ITEM_DEFINED_TRANSFORMATION) {
        const Args ta = b_.args(t);
        const std::int64_t item_1 = b_.reference(t, ta.at(2)), item_2 = b_.reference(t, ta.at(3));
        const bool child_is_1 = belongs(rep_1, child) || !belongs(rep_2, child);
        const std::int64_t rep_child = child_is_1 ? rep_1 : rep_2, rep_parent = child_is_1 ? rep_2 : rep_1;
        std::int64_t item_child = child_is_1 ? item_1 : item_2, item_parent = child_is_1 ? item_2 : item_1;
        if (!holds(rep_child, item_child) && holds(rep_child, item_parent)) std::swap(item_child, item_parent);
        u.T = axes(item_parent, rep_parent) * axes(item_child, rep_child).inverse();
      } else {
        u.T = axes(t.id, rep_2);
      }
    }
    usages_[parent].push_back(u);
  }

  std::string usage_name(const Instance& usage) const {
    const Args a = b_.args(usage);
    const std::string name = b_.text(a.at(1));
    return name.empty() || name == " " ? b_.text(a.at(0)) : name;
  }

  std::string product_name(std::int64_t pd) const {
    try {
      const Instance& d = b_.instance(pd);
      const Instance& formation = b_.instance(b_.reference(d, b_.args(d).at(2)));
      const Instance& product = b_.instance(b_.reference(formation, b_.args(formation).at(2)));
      const std::string name = b_.text(b_.args(product).at(1));
      return name.empty() ? b_.text(b_.args(product).at(0)) : name;
    } catch (const StepFault&) {
      return {};
    }
  }

  void walk(std::int64_t pd, const Eigen::Affine3d& T, int depth, const std::string& path) {
    if (model_.is_cut) return;
    if (depth > kDepthLimit || model_.bodies.size() > kBodiesLimit || ++walks_ > kBodiesLimit) {
      model_.is_cut = true;
      return;
    }
    if (!on_path_.insert(pd).second) return;  // a product inside itself
    const auto o = owned_.find(pd);
    if (o != owned_.end()) {
      std::vector<std::int64_t> reps;
      std::set<std::int64_t> seen;
      for (std::int64_t r : o->second)
        if (seen.insert(r).second) reps.push_back(r);
      for (std::size_t k = 0; k < reps.size() && reps.size() < 10000; ++k) {
        const auto l = links_.find(reps[k]);
        if (l == links_.end()) continue;
        for (std::int64_t n : l->second) {
          const auto other = owner_.find(n);
          if (other != owner_.end() && other->second != pd) continue;  // another product's
          const Instance* i = f_.find(n);
          if (!i || is_drawing(b_.key(*i))) continue;
          if (seen.insert(n).second) reps.push_back(n);
        }
      }
      seen_here_.clear();
      const Names names{product_name(pd), path};
      for (std::int64_t r : reps) gather(r, T, names, 0, false);
    }
    const auto u = usages_.find(pd);
    if (u != usages_.end())
      for (const Usage& use : u->second) walk(use.child, T * use.T, depth + 1, path.empty() ? use.name : path + "/" + use.name);
    on_path_.erase(pd);
  }

  struct Names {
    std::string product, instance;
  };
  void gather(std::int64_t rep, const Eigen::Affine3d& T, const Names& names, int depth, bool only_new) {
    const Instance* i = f_.find(rep);
    if (!i || depth > kDepthLimit) return;
    if (is_drawing(b_.key(*i))) return;
    visited_.insert(rep);
    guarded([&] {
      const Args a = representation(*i);
      if (!a.at(1) || a.at(1)->kind != Kind::list) return;
      for (std::int64_t id : b_.references(*i, a.at(1))) {
        const Instance* it = f_.find(id);
        if (!it || it->record_count == 0) continue;
        if (is_body(*it) || is_triangles(b_.key(*it)) || is_loose(b_.key(*it))) {
          if (depth == 0 && !seen_here_.insert(id).second) continue;
          if (only_new && placed_bodies_.count(id)) continue;
          if (model_.bodies.size() + model_.tessellated.size() + loose_.size() > kBodiesLimit) {
            model_.is_cut = true;
            return;
          }
          placed_bodies_.insert(id);
          BodyUse u{id, units_of(rep), T, names.product, names.instance, rep};
          (is_body(*it) ? model_.bodies : is_loose(b_.key(*it)) ? loose_ : model_.tessellated).push_back(u);
        } else if (b_.key(*it) == K_MAPPED_ITEM) {
          guarded([&] {
            const Args m = b_.args(*it);
            const Instance& map = b_.instance(b_.reference(*it, m.at(1)));
            const Args ma = b_.args(map, K_REPRESENTATION_MAP);
            const std::int64_t mapped = b_.reference(map, ma.at(1));
            const Eigen::Affine3d U = axes(b_.reference(*it, m.at(2)), rep) * axes(b_.reference(map, ma.at(0)), mapped).inverse();
            if (!maps_on_path_.insert(mapped).second) return;
            gather(mapped, T * U, names, depth + 1, only_new);
            maps_on_path_.erase(mapped);
          });
        }
      }
    });
  }

  Binder& b_;
  const File& f_;
  std::vector<Unread>& unread_;
  Model model_;
  std::vector<BodyUse> loose_;
  std::vector<std::int64_t> definitions_in_order_, representations_;
  std::map<std::int64_t, std::vector<std::int64_t>> owned_, links_;  // definition -> representations; plain relationships
  std::unordered_map<std::int64_t, std::int64_t> owner_;
  std::map<std::int64_t, std::vector<Usage>> usages_;
  std::unordered_set<std::int64_t> is_child_, visited_, placed_bodies_, seen_here_, on_path_, maps_on_path_;
  std::unordered_map<std::int64_t, Units> units_;
  std::size_t walks_ = 0;
};

}  // namespace

Model read_model(Binder& b, std::vector<Unread>& unread) { return ModelReader(b, unread).run(); }

}  // namespace asbuilt::step
