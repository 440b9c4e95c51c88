// Bounded-error Hausdorff distance by CGAL (Debian libcgal-dev, libeigen3-dev), an independent judge of certified bounds.
//   g++ -O2 -DNDEBUG -I/usr/include/eigen3 tests/bench/hausdorff.cpp -o target/hausdorff -lgmp -lmpfr
// usage: hausdorff BOUND A.off B.off  prints the distances of A from B and of B from A, each within BOUND
#include <CGAL/Simple_cartesian.h>
#include <CGAL/Surface_mesh.h>
#include <CGAL/Polygon_mesh_processing/distance.h>
#include <CGAL/Polygon_mesh_processing/polygon_soup_to_polygon_mesh.h>
#include <CGAL/Polygon_mesh_processing/orient_polygon_soup.h>
#include <fstream>
#include <iostream>
#include <cstdlib>
typedef CGAL::Simple_cartesian<double> K;
typedef CGAL::Surface_mesh<K::Point_3> Mesh;
namespace PMP = CGAL::Polygon_mesh_processing;
static Mesh load(const char* path) {
    std::ifstream in(path);
    std::string magic; size_t nv, nf, ne;
    in >> magic >> nv >> nf >> ne;
    std::vector<K::Point_3> points(nv);
    for (auto& p : points) { double x, y, z; in >> x >> y >> z; p = K::Point_3(x, y, z); }
    std::vector<std::vector<size_t>> faces(nf);
    for (auto& f : faces) { size_t n; in >> n; f.resize(n); for (auto& i : f) in >> i; }
    PMP::orient_polygon_soup(points, faces);
    Mesh mesh; PMP::polygon_soup_to_polygon_mesh(points, faces, mesh);
    return mesh;
}
int main(int argc, char** argv) {
    if (argc != 4) { std::cerr << "usage: hausdorff BOUND A.off B.off\n"; return 2; }
    double bound = std::atof(argv[1]);
    Mesh a = load(argv[2]), b = load(argv[3]);
    std::cout.precision(17);
    std::cout << PMP::bounded_error_Hausdorff_distance<CGAL::Sequential_tag>(a, b, bound) << " ";
    std::cout << PMP::bounded_error_Hausdorff_distance<CGAL::Sequential_tag>(b, a, bound) << std::endl;
}
