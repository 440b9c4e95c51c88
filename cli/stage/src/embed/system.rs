//! The sparse linear system of a Tutte embedding: every inner vertex is the weighted mean of its neighbours.
//!
//! The matrix keeps its pattern while the weights change, so it is ordered and analysed only once. The factorisation is
//! always the simplicial one: scalar code whose operations do not depend on the processor, so all machines get the same
//! bits. Supernodal kernels use wider vectors and fused operations. Measured over a whole embedding with one
//! reweighting, supernodal against simplicial, in CPU seconds per million triangles: 0.84 to 0.79 and 0.76 to 0.81 for
//! two scans in charts of 8 thousand triangles, but 0.77 to 0.99 in charts of 16 thousand. Larger charts pay for the
//! same bits.

use faer::Conj;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::LltRegularization;
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LltRef, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering,
    factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{MatMut, Par, Side};
use glam::DVec2;

use super::EmbedError;
use super::chords::Refined;
use lodpack_mesh::NONE;

/// An inner edge with at least one end off the border.
#[derive(Clone, Copy, Debug)]
pub(super) struct Edge {
    pub ends: [u32; 2],
    /// Index of its weight among the matrix values; [`NONE`] if one end is on the border.
    slot: u32,
}

/// The Laplace matrix of a chart's inner vertices, its factorisation, and working memory.
pub(super) struct System {
    pub edges: Vec<Edge>,
    /// Row of each vertex; [`NONE`] on the border.
    row: Vec<u32>,
    /// Vertex of each row.
    vertex: Vec<u32>,
    // The lower triangle by columns, each with its diagonal first.
    column_start: Vec<u32>,
    row_index: Vec<u32>,
    values: Vec<f64>,
    symbolic: SymbolicCholesky<u32>,
    factor: Vec<f64>,
    memory: MemBuffer,
    // Both right-hand sides, one after the other.
    right: Vec<f64>,
}

impl System {
    /// Orders and analyses the system of a chart. `None` if all vertices are on the border.
    pub fn new(refined: &Refined) -> Result<Option<Self>, EmbedError> {
        let mut row = vec![NONE; refined.vertex_count()];
        let mut vertex = Vec::with_capacity(refined.vertex_count());
        for t in &refined.triangles {
            // Rows follow the order of the triangles; a vertex that no triangle uses gets none.
            for &v in t {
                if !refined.on_border[v as usize] && row[v as usize] == NONE {
                    row[v as usize] = vertex.len() as u32;
                    vertex.push(v);
                }
            }
        }
        let n = vertex.len();
        if n == 0 {
            return Ok(None);
        }

        let mut edges = Vec::with_capacity(refined.triangles.len() * 3 / 2);
        let mut column_start = vec![0u32; n + 1];
        for (h, &opposite) in refined.adjacency.opposite.iter().enumerate() {
            if opposite == NONE || (opposite as usize) < h {
                continue;
            }
            let t = refined.triangles[h / 3];
            let ends = [t[h % 3], t[(h + 1) % 3]];
            let [a, b] = ends.map(|v| row[v as usize]);
            if a == NONE && b == NONE {
                continue; // With both ends on the border it would be a chord, and chords are halved.
            }
            edges.push(Edge { ends, slot: NONE });
            if a != NONE && b != NONE {
                column_start[a.min(b) as usize + 1] += 1;
            }
        }
        for column in 0..n {
            column_start[column + 1] += column_start[column] + 1;
        }
        let mut next: Vec<u32> = column_start[..n].iter().map(|&start| start + 1).collect();
        let mut row_index = vec![0u32; column_start[n] as usize];
        for column in 0..n {
            row_index[column_start[column] as usize] = column as u32;
        }
        for edge in &mut edges {
            let [a, b] = edge.ends.map(|v| row[v as usize]);
            if a != NONE && b != NONE {
                let slot = &mut next[a.min(b) as usize];
                edge.slot = *slot;
                row_index[*slot as usize] = a.max(b);
                *slot += 1;
            }
        }

        let failed = |_| EmbedError::Factorisation;
        let pattern = SymbolicSparseColMatRef::new_unsorted_checked(n, n, &column_start, None, &row_index);
        let parameters = CholeskySymbolicParams {
            supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SIMPLICIAL,
            ..Default::default()
        };
        let symbolic =
            factorize_symbolic_cholesky(pattern, Side::Lower, SymmetricOrdering::Amd, parameters).map_err(failed)?;
        let request = symbolic
            .factorize_numeric_llt_scratch::<f64>(Par::Seq, Default::default())
            .or(symbolic.solve_in_place_scratch::<f64>(2, Par::Seq));
        let memory = MemBuffer::try_new(request).map_err(|_| EmbedError::Factorisation)?;
        Ok(Some(Self {
            edges,
            row,
            vertex,
            values: vec![0.0; row_index.len()],
            column_start,
            row_index,
            factor: vec![0.0; symbolic.len_val()],
            symbolic,
            memory,
            right: vec![0.0; 2 * n],
        }))
    }

    /// Factorises the matrix for the given weights: one per edge, all positive.
    pub fn factorise(&mut self, weights: &[f64]) -> Result<(), EmbedError> {
        self.values.fill(0.0);
        for (edge, &weight) in self.edges.iter().zip(weights) {
            for v in edge.ends {
                if let Some(&start) = self.column_start.get(self.row[v as usize] as usize) {
                    self.values[start as usize] += weight;
                }
            }
            if edge.slot != NONE {
                self.values[edge.slot as usize] = -weight;
            }
        }
        let n = self.vertex.len();
        let pattern = SymbolicSparseColMatRef::new_unsorted_checked(n, n, &self.column_start, None, &self.row_index);
        self.symbolic
            .factorize_numeric_llt(
                &mut self.factor,
                SparseColMatRef::new(pattern, self.values.as_slice()),
                Side::Lower,
                LltRegularization::default(),
                Par::Seq,
                MemStack::new(&mut self.memory),
                Default::default(),
            )
            .map_err(|_| EmbedError::Factorisation)?;
        Ok(())
    }

    /// A lower bound on the condition number of the factorised matrix, whose eigenvalues enclose the squares of the
    /// factor's diagonal.
    pub fn conditioning(&self) -> f64 {
        let SymbolicCholeskyRaw::Simplicial(symbolic) = self.symbolic.raw() else { return 1.0 };
        // The diagonal comes first in each column.
        let diagonal = symbolic.col_ptr()[..self.vertex.len()].iter().map(|&start| self.factor[start as usize]);
        let (least, most) = diagonal.fold((f64::INFINITY, 0.0f64), |(least, most), l| (least.min(l), most.max(l)));
        (most / least) * (most / least)
    }

    /// Improves the inner vertices by one step of iterative refinement with the current factorisation, starting from
    /// any `uv`.
    ///
    /// The residual is summed over differences of neighbours, so it keeps its relative accuracy where the map is
    /// crowded. With all inner vertices at the centre, one step is the plain solution.
    pub fn improve(&mut self, weights: &[f64], uv: &mut [DVec2]) {
        let n = self.vertex.len();
        self.sum_forces(weights, uv);
        let mut right = MatMut::from_column_major_slice_mut(&mut self.right, n, 2);
        LltRef::new(&self.symbolic, &self.factor).solve_in_place_with_conj(
            Conj::No,
            right.as_mut(),
            Par::Seq,
            MemStack::new(&mut self.memory),
        );
        for (i, &v) in self.vertex.iter().enumerate() {
            uv[v as usize] += DVec2::new(self.right[i], self.right[n + i]);
        }
    }

    /// The largest distance of an inner vertex from the weighted mean of its neighbours, in radii of the polygon.
    pub fn residual(&mut self, weights: &[f64], uv: &[DVec2]) -> f64 {
        self.sum_forces(weights, uv);
        let n = self.vertex.len();
        let mut residual = 0.0f64;
        for i in 0..n {
            let diagonal = self.values[self.column_start[i] as usize];
            residual = residual.max(DVec2::new(self.right[i], self.right[n + i]).length() / diagonal);
        }
        residual
    }

    /// Sums weight times difference over the neighbours of each inner vertex, into `right`.
    fn sum_forces(&mut self, weights: &[f64], uv: &[DVec2]) {
        let n = self.vertex.len();
        self.right.fill(0.0);
        let (right_x, right_y) = self.right.split_at_mut(n);
        for (edge, &weight) in self.edges.iter().zip(weights) {
            let force = (uv[edge.ends[1] as usize] - uv[edge.ends[0] as usize]) * weight;
            let [a, b] = edge.ends.map(|v| self.row[v as usize] as usize);
            if a < n {
                right_x[a] += force.x;
                right_y[a] += force.y;
            }
            if b < n {
                right_x[b] -= force.x;
                right_y[b] -= force.y;
            }
        }
    }
}
