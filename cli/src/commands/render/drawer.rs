//! Who draws where nobody was named: the graphics device if there is one, else the processor.

use clap::ValueEnum;
use octree_store::Store;
use render_check::gpu::{AdapterChoice, GpuBackend, Sampling};
use render_check::{Backend, CpuBackend, Renderer, RendererOptions};

/// Who draws.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub(in crate::commands) enum Drawer {
    /// Vulkan where there is any, else the processor
    #[default]
    Auto,
    /// Vulkan
    Gpu,
    /// The processor
    Cpu,
    /// Nobody
    None,
}

impl Drawer {
    /// A renderer of a store; none where nobody draws.
    pub(in crate::commands) fn renderer(
        self,
        store: Store,
        options: &RendererOptions,
    ) -> anyhow::Result<Option<Renderer>> {
        let (geometry, metadata) = (*store.geometry(), store.metadata());
        let slots = options.slots_for(&geometry);
        let cpu = || -> Box<dyn Backend> {
            Box::new(CpuBackend::new(&geometry, metadata.spacing_xyz, slots))
        };
        let gpu = || {
            let choice = AdapterChoice::default();
            GpuBackend::new(&choice, Sampling::Hardware, &geometry, metadata, slots)
        };
        let backend = match self {
            Self::None => return Ok(None),
            Self::Cpu => cpu(),
            Self::Gpu => Box::new(gpu()?),
            Self::Auto => match gpu() {
                Ok(backend) => Box::new(backend),
                Err(_) => cpu(),
            },
        };
        Ok(Some(Renderer::new(store, backend, options)?))
    }
}
