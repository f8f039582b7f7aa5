//! Lists of the splats of files that cover a tile, made on the device when the splats are in order.
//!
//! The runtime says of each splat which tiles it reaches. Sums of how many these are, along the order of depth, tell where its entries
//! begin ([`sums`], the scan of the sort, and [`starts`]); [`spread`] makes an entry for each, which is a tile and a splat; these are
//! sorted by tile, stably, so that in a tile they stay in the order of depth; and [`fill`] writes them down. Each entry is found from
//! its number by bisection: no invocation loops over the tiles of a splat, which may be all there are.

use super::sort::{self, GROUP, each, place, sum_up};
use crate::fields::{Code, KernelBuilder};
use crate::program::kernel::{Expr, Function, Stage, Ty};
use crate::program::{FrameValue, ListPasses, SortBuffer, SortPass};

const THREADS: u32 = SortPass::THREADS;
const EACH: u32 = SortPass::TAKES / THREADS;

/// What is known of a splat's tiles, and how many they are.
struct Reach {
    parts: [Expr; 4],
}

impl Reach {
    fn read(builder: &mut KernelBuilder, code: &mut Code, splat: &Expr) -> Self {
        let reaches = builder.reaches();
        let base = code.bind("base", Ty::U32, splat.clone() * 4u32);
        let names = ["first_tile", "first_of_rest", "widths", "rows"];
        let parts = std::array::from_fn(|i| {
            let part = Expr::load(reaches, base.clone() + i as u32);
            code.bind(names[i], Ty::U32, part)
        });
        Self { parts }
    }

    /// Columns of the main part, and of both.
    fn widths(&self) -> (Expr, Expr) {
        let main = self.parts[2].clone() / 65536u32;
        (main.clone(), main.clone() + (self.parts[2].clone() - main * 65536u32))
    }

    fn tiles(&self) -> Expr {
        self.widths().1 * self.parts[3].clone()
    }
}

/// Sums of tiles of the splats of this invocation, which lie together in their order; `body` gets each splat's place and the sum before it.
fn own_sums(
    builder: &mut KernelBuilder,
    code: &mut Code,
    (group, lane): (&Expr, &Expr),
    from: impl Into<Expr>,
    mut body: impl FnMut(&mut Code, &Expr, &Expr),
) -> Expr {
    let order = builder.order();
    let count = builder.frame(FrameValue::SortCount);
    let first = code.bind("first", Ty::U32, group.clone() * SortPass::TAKES + lane.clone() * EACH);
    let sum = code.var("sum", Ty::U32, from);
    each(code, "nth", EACH, |code, nth| {
        let at = code.bind("at", Ty::U32, first + nth.clone());
        code.break_if(at.clone().greater_equal(count));
        let splat = code.bind("splat", Ty::U32, Expr::load(order, at.clone()));
        let reach = Reach::read(builder, code, &splat);
        let before = code.bind("sum_before", Ty::U32, sum);
        body(code, &at, &before);
        code.add(sum, reach.tiles());
    });
    code.bind("own_sum", Ty::U32, sum)
}

/// How many tiles the splats of a workgroup reach.
fn sums(builder: &mut KernelBuilder) -> Function {
    let mut code = Code::new("list_sums", None);
    let (group, lane) = place(&mut code);
    let (tallies, shared) = (builder.tallies(), builder.workgroup("sums", THREADS));
    let sum = own_sums(builder, &mut code, (&group, &lane), 0u32, |_, _, _| {});
    code.store(shared, lane.clone(), sum);
    code.barrier();
    sum_up(&mut code, (shared, &lane), THREADS);
    let count = builder.frame(FrameValue::SortCount);
    let last = lane.clone().equal(THREADS - 1).and((group.clone() * SortPass::TAKES).less(count));
    code.if_(last, |code| code.store(tallies, group, Expr::load(shared, lane)));
    code.finish(None)
}

/// Where the entries of each splat begin.
fn starts(builder: &mut KernelBuilder) -> Function {
    let mut code = Code::new("list_starts", None);
    let (group, lane) = place(&mut code);
    let (tallies, shared) = (builder.tallies(), builder.workgroup("sums", THREADS));
    let starts = builder.starts();
    let sum = own_sums(builder, &mut code, (&group, &lane), 0u32, |_, _, _| {});
    code.store(shared, lane.clone(), sum.clone());
    code.barrier();
    sum_up(&mut code, (shared, &lane), THREADS);
    let before = Expr::load(tallies, group.clone()) + Expr::load(shared, lane.clone()) - sum;
    let before = code.bind("all_before", Ty::U32, before);
    own_sums(builder, &mut code, (&group, &lane), before, |code, at, before| {
        code.store(starts, at.clone(), before.clone());
    });
    code.finish(None)
}

/// The number of this invocation's entry. Leaves the kernel where there is none.
fn own_entry(builder: &mut KernelBuilder, code: &mut Code) -> Expr {
    let (group, lane) = place(code);
    let entry = code.bind("entry", Ty::U32, group * THREADS + lane);
    let count = builder.frame(FrameValue::ListEntries);
    code.if_(entry.clone().greater_equal(count), Code::return_nothing);
    entry
}

/// The tile and the splat of each entry.
fn spread(builder: &mut KernelBuilder) -> Function {
    let mut code = Code::new("list_spread", None);
    let entry = own_entry(builder, &mut code);
    let (order, starts) = (builder.order(), builder.starts_read());
    let (keys, entries) = (builder.keys(), builder.entries());
    let count = builder.frame(FrameValue::SortCount);
    // The last splat that begins here or before: of those that begin together all but the last have no tiles.
    let beyond = sort::lower_bound(&mut code, (starts, &count), &(entry.clone() + 1u32));
    let at = code.bind("at", Ty::U32, beyond - 1u32);
    let splat = code.bind("splat", Ty::U32, Expr::load(order, at.clone()));
    let reach = Reach::read(builder, &mut code, &splat);
    let (main, width) = reach.widths();
    let (main, width) = (code.bind("main", Ty::U32, main), code.bind("width", Ty::U32, width));
    let nth = code.bind("nth", Ty::U32, entry.clone() - Expr::load(starts, at));
    let row = code.bind("row", Ty::U32, nth.clone() / width.clone());
    let column = code.bind("column", Ty::U32, nth - row.clone() * width);
    let [first, rest, ..] = reach.parts;
    let place = column.clone().less(main.clone()).select(first + column.clone(), rest + (column - main));
    let columns = builder.frame(FrameValue::ListColumns);
    code.store(keys, entry.clone(), place + row * columns);
    code.store(entries, entry, splat);
    code.finish(None)
}

/// Writes the splats of sorted entries into the lists, whose heads are there.
fn fill(builder: &mut KernelBuilder) -> Function {
    let mut code = Code::new("list_fill", None);
    let entry = own_entry(builder, &mut code);
    let (numbers, entries) = (builder.sorting(SortBuffer::NumbersFrom), builder.entries_read());
    let lists = builder.tile_lists_written();
    // The first list begins where heads end.
    let head = code.bind("head", Ty::U32, Expr::load(lists, Expr::U32(0)));
    let number = code.bind("number", Ty::U32, Expr::load(numbers, entry.clone()));
    let splat = code.bind("splat", Ty::U32, Expr::load(entries, number));
    code.store(lists, head + entry, splat);
    code.finish(None)
}

/// Adds the kernels to the others, and says which they are.
pub(super) fn add(builder: &mut KernelBuilder, entries: &mut Vec<(&str, Stage, Function)>) -> ListPasses {
    let first = entries.len() as u32;
    entries.push(("list_sums", GROUP, sums(builder)));
    entries.push(("list_starts", GROUP, starts(builder)));
    entries.push(("list_spread", GROUP, spread(builder)));
    entries.push(("list_fill", GROUP, fill(builder)));
    ListPasses { sums: first, starts: first + 1, spread: first + 2, fill: first + 3 }
}
